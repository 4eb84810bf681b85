// nadir keys permit-rollback: allows aircraft to go back from one package to an older one.
#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "base/error.hpp"
#include "base/files.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "commands/keys/root_signing.hpp"
#include "trust/rollback_permit.hpp"

namespace nadir {
namespace {

class KeysPermitRollbackCommand final : public Command {
 public:
  std::string_view group() const override { return "keys"; }
  std::string_view name() const override { return "permit-rollback"; }
  std::string_view summary() const override { return "permit aircraft to go back to an older package"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::vector<std::filesystem::path> keys_;
  std::string series_;
  std::int64_t from_ = 0;
  std::int64_t to_ = 0;
  std::optional<std::string> airframe_;
  UtcTime expires_;
  std::filesystem::path out_;
};

std::string_view KeysPermitRollbackCommand::details() const {
  return R"(For a package that turns out to be bad after aircraft have accepted it. The permit applies to one
series, from exactly one sequence to exactly one other, until its date, and with --airframe to that
airframe only. It must be signed by as many package signers as the root requires; others add their
signatures with `nadir keys sign`. Use it with `nadir cache verify --permit`. The highest sequence
recorded on the aircraft does not decrease.)";
}

std::string_view KeysPermitRollbackCommand::examples() const {
  return R"(nadir keys permit-rollback --key planner.key.pem --series valley --from 8 --to 7 --expires 2030-01-01 --out permit.json)";
}

void KeysPermitRollbackCommand::setup(Options& options) {
  options.values("--key", keys_, "KEY.pem", "private key of a package signer; may be repeated").required();
  options.value("--series", series_, "SERIES", "series of the packages").required();
  options.value("--from", from_, "N", "highest sequence that the aircraft have accepted").required();
  options.value("--to", to_, "N", "older sequence that they may accept again").required();
  options.value("--airframe", airframe_, "ID", "for this airframe only");
  options.value("--expires", expires_, "DATE", "end of validity").required();
  options.value("--out", out_, "PERMIT.json", "permit file to create").required();
}

int KeysPermitRollbackCommand::run(Context& context) {
  if (std::filesystem::exists(std::filesystem::symlink_status(out_))) {
    throw UsageError({.what = "the output already exists", .where = out_, .fix = "choose another --out"});
  }
  check_expires(expires_, context.clock);
  if (to_ >= from_ || to_ < 0) {
    throw UsageError({.what = "--to is not lower than --from",
                      .expected = "a sequence from 0 to " + std::to_string(from_ - 1),
                      .found = std::to_string(to_)});
  }
  const std::vector<PrivateKey> keys = read_private_keys(keys_);
  const SignedPermit permit = sign_permit({series_, from_, to_, airframe_, expires_}, pointers_to(keys));
  write_new_file(out_, permit.document.json());
  if (context.json) {
    print_json(context.out, {{"permit", out_.string()},
                             {"series", series_},
                             {"from", from_},
                             {"to", to_},
                             {"expires", to_rfc3339(expires_)},
                             {"signatures", permit.document.signatures.size()}});
  } else {
    print_figures(context.out, {{"permit", out_.string()},
                                {"series", series_},
                                {"from sequence", std::to_string(from_)},
                                {"to sequence", std::to_string(to_)},
                                {"airframe", airframe_.value_or("any")},
                                {"expires", to_rfc3339(expires_)},
                                {"signatures", std::to_string(permit.document.signatures.size())}});
  }
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_keys_permit_rollback() { return std::make_unique<KeysPermitRollbackCommand>(); }

}  // namespace nadir
