// nadir keys permit-rollback: allows aircraft to go back from one package to an older one.
#include <cstdint>
#include <string>

#include "base/error.hpp"
#include "commands/commands.hpp"
#include "commands/keys/permit_command.hpp"
#include "trust/rollback_permit.hpp"

namespace nadir {
namespace {

class KeysPermitRollbackCommand final : public PermitCommand {
 public:
  std::string_view name() const override { return "permit-rollback"; }
  std::string_view summary() const override { return "permit aircraft to go back to an older package"; }
  std::string_view details() const override;
  std::string_view examples() const override;

 private:
  void setup_step(Options& options) override;
  void check_step() const override;
  Figures step_figures() const override;
  SignedDocument sign(const SigningKeys& keys) const override;

  std::string series_;
  std::int64_t from_ = 0;
  std::int64_t to_ = 0;
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

void KeysPermitRollbackCommand::setup_step(Options& options) {
  options.value("--series", series_, "SERIES", "series of the packages").required();
  options.value("--from", from_, "N", "highest sequence that the aircraft have accepted").required();
  options.value("--to", to_, "N", "older sequence that they may accept again").required();
}

void KeysPermitRollbackCommand::check_step() const {
  if (from_ < 1) {
    throw UsageError({.what = "--from leaves no older sequence to go back to",
                      .expected = "a sequence of 1 or more",
                      .found = std::to_string(from_)});
  }
  if (to_ >= from_ || to_ < 0) {
    throw UsageError({.what = "--to is not lower than --from",
                      .expected = "a sequence from 0 to " + std::to_string(from_ - 1),
                      .found = std::to_string(to_)});
  }
}

Figures KeysPermitRollbackCommand::step_figures() const {
  return {{"series", series_}, {"from sequence", std::to_string(from_)}, {"to sequence", std::to_string(to_)}};
}

SignedDocument KeysPermitRollbackCommand::sign(const SigningKeys& keys) const {
  return sign_permit({series_, from_, to_, airframe(), expires()}, keys).document;
}

}  // namespace

std::unique_ptr<Command> make_keys_permit_rollback() { return std::make_unique<KeysPermitRollbackCommand>(); }

}  // namespace nadir
