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
  options.value("--state", state_file_, "STATE.json",
                "packages that this aircraft has accepted before; updated on acceptance");
  options.value("--permit", permit_file_, "PERMIT.json", "signed permit for a rollback to this package")
      .needs("--state");
  options
      .value("--time-permit", time_permit_file_, "PERMIT.json",
             "signed permit to forget a remembered time that was wrong")
      .needs("--state");
  options.value("--at", at_, "TIME", "evaluate validity as of this time; nothing is recorded");
}

VerifyOptions VerifyRequest::open(const Clock& clock) {
  if (trust_file_.empty()) throw UsageError({.what = "--trust ROOT.json is required"});
  root_ = read_trusted_root(trust_file_);
  evaluated_at_ = evaluation_time(at_, clock);
  findings_ = {};
  if (state_file_) {
    StateReading reading = check_state(*state_file_);
    findings_.add(reading.findings);
    state_ = std::move(reading.state);
  }
  if (permit_file_) read_permit(*permit_file_);
  if (time_permit_file_) read_time_permit(*time_permit_file_);
  VerifyOptions options;
  options.root = &root_;
  options.at = evaluated_at_;
  options.airframe = airframe_;
  options.state = state_ ? &*state_ : nullptr;
  options.permit = permit_ ? &*permit_ : nullptr;
  options.time_permit = time_permit_ ? &*time_permit_ : nullptr;
  return options;
}

namespace {

Finding invalid_permit(const std::filesystem::path& path, const Error& error, const char* expected) {
  return {.code = "permit.invalid",
          .where = path.string(),
          .expected = error.text().expected.empty() ? expected : error.text().expected,
          .found = error.text().found.empty() ? error.text().what : error.text().found,
          .fix = "obtain the permit from the signers again"};
}

}  // namespace

void VerifyRequest::read_permit(const std::filesystem::path& path) {
  const std::string text = read_text_file(path, kMaxPermitSize);
  try {
    permit_ = parse_permit(text, path.string());
  } catch (const Error& error) {
    findings_.add(invalid_permit(path, error, "a rollback permit"));
  }
}

void VerifyRequest::read_time_permit(const std::filesystem::path& path) {
  const std::string text = read_text_file(path, kMaxPermitSize);
  try {
    time_permit_ = parse_time_permit(text, path.string());
  } catch (const Error& error) {
    findings_.add(invalid_permit(path, error, "a time permit"));
  }
}

void VerifyRequest::remember(const Manifest& manifest, std::int64_t root_version,
                             const std::map<std::int64_t, std::string>& newer_roots,
                             const std::optional<UtcTime>& time_reset) {
  if (!state_) return;
  const std::optional<UtcTime> known_time = state_->last_trusted_time;
  if (time_reset) state_->last_trusted_time = time_reset;
  state_->accept(manifest.series, manifest.sequence, root_version, remembered_time(evaluated_at_, manifest.created),
                 newer_roots);
  if (at_) state_->last_trusted_time = known_time;
  if (airframe_ && airframe_sequence_) state_->accept_airframe(*airframe_, *airframe_sequence_);
}

void VerifyRequest::write_memory() const {
  if (state_) write_state(*state_file_, *state_);
}

}  // namespace nadir
