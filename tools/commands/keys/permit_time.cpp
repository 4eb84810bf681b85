// nadir keys permit-time: allows an aircraft to forget a remembered time that was wrong.
#include "base/error.hpp"
#include "commands/commands.hpp"
#include "commands/keys/permit_command.hpp"
#include "trust/time_permit.hpp"

namespace nadir {
namespace {

class KeysPermitTimeCommand final : public PermitCommand {
 public:
  std::string_view name() const override { return "permit-time"; }
  std::string_view summary() const override { return "permit an aircraft to forget a wrong time"; }
  std::string_view details() const override;
  std::string_view examples() const override;

 private:
  void setup_step(Options& options) override;
  void check_step() const override;
  Figures step_figures() const override;
  SignedDocument sign(const SigningKeys& keys) const override;

  UtcTime remembered_;
  UtcTime instead_;
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

void KeysPermitTimeCommand::setup_step(Options& options) {
  options.value("--remembered", remembered_, "TIME", "exactly the time that the aircraft remembers").required();
  options.value("--instead", instead_, "TIME", "earlier time that takes its place").required();
}

void KeysPermitTimeCommand::check_step() const {
  if (instead_ < remembered_) return;
  throw UsageError({.what = "--instead is not before --remembered",
                    .expected = "a time before " + to_rfc3339(remembered_),
                    .found = to_rfc3339(instead_)});
}

Figures KeysPermitTimeCommand::step_figures() const {
  return {{"remembered", to_rfc3339(remembered_)}, {"instead", to_rfc3339(instead_)}};
}

SignedDocument KeysPermitTimeCommand::sign(const SigningKeys& keys) const {
  return sign_time_permit({remembered_, instead_, airframe(), expires()}, keys).document;
}

}  // namespace

std::unique_ptr<Command> make_keys_permit_time() { return std::make_unique<KeysPermitTimeCommand>(); }

}  // namespace nadir
