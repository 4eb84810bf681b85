// nadir keys permit-time: allows an aircraft to forget a remembered time that was wrong.
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
#include "trust/time_permit.hpp"

namespace nadir {
namespace {

class KeysPermitTimeCommand final : public Command {
 public:
  std::string_view group() const override { return "keys"; }
  std::string_view name() const override { return "permit-time"; }
  std::string_view summary() const override { return "permit an aircraft to forget a wrong time"; }
  std::string_view details() const override;
  std::string_view examples() const override;
  bool offers_json() const override { return true; }

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::vector<std::filesystem::path> keys_;
  UtcTime remembered_;
  UtcTime instead_;
  std::optional<std::string> airframe_;
  UtcTime expires_;
  std::filesystem::path out_;
};

std::string_view KeysPermitTimeCommand::details() const {
  return R"(An aircraft accepts no clock earlier than the time of its last acceptance. When that time was wrong
(a clock that ran ahead), every right clock is refused with time.untrusted, which names the time. The
permit replaces exactly that time by another, once, and with --airframe on that airframe only. It must
be signed by as many package signers as the root requires; others add their signatures with `nadir
keys sign`. Use it with --time-permit of `nadird` or `nadir cache verify`.)";
}

std::string_view KeysPermitTimeCommand::examples() const {
  return R"(nadir keys permit-time --key planner.key.pem --remembered 2027-03-01T00:00:00Z --instead 2026-05-01 --expires 2030-01-01 --airframe mini-07 --out permit.json)";
}

void KeysPermitTimeCommand::setup(Options& options) {
  options.values("--key", keys_, "KEY.pem", "private key of a package signer; may be repeated").required();
  options.value("--remembered", remembered_, "TIME", "exactly the time that the aircraft remembers").required();
  options.value("--instead", instead_, "TIME", "earlier time that takes its place").required();
  options.value("--airframe", airframe_, "ID", "for this airframe only");
  options.value("--expires", expires_, "DATE", "end of validity").required();
  options.value("--out", out_, "PERMIT.json", "permit file to create").required();
}

int KeysPermitTimeCommand::run(Context& context) {
  if (std::filesystem::exists(std::filesystem::symlink_status(out_))) {
    throw UsageError({.what = "the output already exists", .where = out_, .fix = "choose another --out"});
  }
  if (expires_ <= context.clock.now()) {
    throw UsageError({.what = "--expires is in the past",
                      .expected = "a time after " + to_rfc3339(context.clock.now()),
                      .found = to_rfc3339(expires_)});
  }
  if (instead_ >= remembered_) {
    throw UsageError({.what = "--instead is not before --remembered",
                      .expected = "a time before " + to_rfc3339(remembered_),
                      .found = to_rfc3339(instead_)});
  }
  const std::vector<PrivateKey> keys = read_private_keys(keys_);
  const SignedTimePermit permit = sign_time_permit({remembered_, instead_, airframe_, expires_}, pointers_to(keys));
  write_file_atomic(out_, permit.document.json());
  if (context.json) {
    print_json(context.out, {{"permit", out_.string()},
                             {"remembered", to_rfc3339(remembered_)},
                             {"instead", to_rfc3339(instead_)},
                             {"expires", to_rfc3339(expires_)},
                             {"signatures", permit.document.signatures.size()}});
  } else {
    print_figures(context.out, {{"permit", out_.string()},
                                {"remembered", to_rfc3339(remembered_)},
                                {"instead", to_rfc3339(instead_)},
                                {"airframe", airframe_.value_or("any")},
                                {"expires", to_rfc3339(expires_)},
                                {"signatures", std::to_string(permit.document.signatures.size())}});
  }
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_keys_permit_time() { return std::make_unique<KeysPermitTimeCommand>(); }

}  // namespace nadir
