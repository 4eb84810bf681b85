#include "verify_request/verify_request.hpp"

#include "base/error.hpp"
#include "base/files.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"

namespace nadir {

void VerifyRequest::setup(Options& options, Trust trust) {
  Option trust_option = options.value("--trust", trust_file_, "ROOT.json", "root of trust");
  if (trust == Trust::required) trust_option.required();
  options.value("--airframe", airframe_, "ID", "reject packages that are not for this airframe");
  options.value("--state", state_file_, "STATE.json", "packages that this aircraft has accepted before; updated on acceptance");
  options.value("--permit", permit_file_, "PERMIT.json", "signed permit for a rollback to this package")
      .needs("--state");
  options.value("--at", at_, "TIME", "evaluate validity as of this time");
}

VerifyOptions VerifyRequest::open(const Clock& clock) {
  if (trust_file_.empty()) throw UsageError({.what = "--trust ROOT.json is required"});
  root_ = read_trusted_root(trust_file_);
  evaluated_at_ = evaluation_time(at_, clock);
  if (state_file_) {
    StateReading reading = check_state(*state_file_);
    findings_.add(reading.findings);
    state_ = std::move(reading.state);
  }
  if (permit_file_) read_permit(*permit_file_);
  VerifyOptions options;
  options.root = &root_;
  options.at = evaluated_at_;
  options.airframe = airframe_;
  options.state = state_ ? &*state_ : nullptr;
  options.permit = permit_ ? &*permit_ : nullptr;
  return options;
}

void VerifyRequest::read_permit(const std::filesystem::path& path) {
  const std::string text = read_text_file(path, kMaxPermitSize);
  try {
    permit_ = parse_permit(text, path.string());
  } catch (const Error& error) {
    findings_.add({.code = "permit.invalid",
                   .where = path.string(),
                   .expected = error.text().expected.empty() ? "a rollback permit" : error.text().expected,
                   .found = error.text().found.empty() ? error.text().what : error.text().found,
                   .fix = "obtain the permit from the signers again"});
  }
}

void VerifyRequest::record_acceptance(const Manifest& manifest, std::int64_t root_version,
                             const std::map<std::int64_t, std::string>& newer_roots) {
  if (!state_) return;
  state_->accept(manifest.series, manifest.sequence, root_version, evaluated_at_, newer_roots);
  if (airframe_ && airframe_sequence_) state_->accept_airframe(*airframe_, *airframe_sequence_);
  write_state(*state_file_, *state_);
}

}  // namespace nadir
