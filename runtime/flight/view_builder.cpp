#include "flight/view_builder.hpp"

namespace nadir {
namespace {

constexpr double kRateWindow_s = 2;

GpsJudgement shown(GpsVerdict verdict) {
  switch (verdict) {
    case GpsVerdict::trusted: return GpsJudgement::good;
    case GpsVerdict::denied: return GpsJudgement::denied;
    case GpsVerdict::spoofed: return GpsJudgement::spoofed;
    case GpsVerdict::unknown: break;
  }
  return GpsJudgement::unknown;
}

}  // namespace

void ViewBuilder::localizer(const LocalizerEvent& spoke) {
  const Estimate& estimate = spoke.estimate;
  view_.position.reset();
  if (estimate.position) {
    const auto& p = estimate.covariance_m2;
    view_.position = PositionView{*estimate.position, estimate.sigma_m, p(0, 0), p(1, 1), p(0, 1)};
    trail_.add({spoke.taken_s, *estimate.position, estimate.sigma_m, estimate.source});
  }
  view_.source = estimate.source;
  view_.anchor_age_s = estimate.anchor_age_s;
  view_.heading_rad = spoke.belief.heading_rad;
  view_.pitch_rad = spoke.pitch_rad;
  view_.roll_rad = spoke.roll_rad;
  view_.velocity = VelocityView{spoke.belief.velocity_mps.x(), spoke.belief.velocity_mps.y()};
  view_.agl_m = spoke.belief.agl_m;
  if (spoke.verdict == AnchorVerdict::accepted) ++view_.anchors.accepted;
  if (spoke.verdict != AnchorVerdict::accepted && spoke.verdict != AnchorVerdict::not_tried) {
    ++view_.anchors.rejected;
    ++view_.anchors.rejected_by[std::string(name_of(spoke.verdict))];
  }
}

void ViewBuilder::gps(const GpsJudged& judged) { view_.gps = {shown(judged.verdict), judged.why}; }

void ViewBuilder::status(const ServiceStatus& status, const std::string& reason) {
  view_.state = {status.state, reason, status.since_s};
}

void ViewBuilder::permit(const ServiceStatus& status, const std::optional<Fix>& told, double now_s) {
  if (status.state == ServiceState::normal) return;
  view_.position.reset();
  view_.velocity.reset();
  view_.heading_rad = view_.pitch_rad = view_.roll_rad = std::nullopt;  // the last picture's
  view_.source = SourceLabel::no_fix;
  if (status.state != ServiceState::degraded || !told) return;
  const double variance_m2 = told->sigma_m * told->sigma_m;
  view_.position = PositionView{told->place, told->sigma_m, variance_m2, variance_m2, 0};
  view_.source = SourceLabel::dead_reckoned;
  if (told->velocity) view_.velocity = VelocityView{told->velocity->east_m_s, told->velocity->north_m_s};
  trail_.add({now_s, told->place, told->sigma_m, view_.source});
}

void ViewBuilder::frames(const MailboxCounts& counts, double now_s) {
  view_.frames.received = counts.put;
  view_.frames.dropped = counts.dropped;
  if (now_s - rate_since_s_ < kRateWindow_s) return;
  view_.frames.per_s = static_cast<double>(counts.put - rate_from_) / (now_s - rate_since_s_);
  rate_since_s_ = now_s;
  rate_from_ = counts.put;
}

void ViewBuilder::link(const AutopilotLink::State& state, bool connected, bool is_signed) {
  const LinkCounts& counts = state.counts;
  view_.link.connected = connected;
  view_.link.signed_frames = is_signed;
  view_.link.fixes_sent = state.fixes_sent;
  view_.link.rejected_by = {{"bad_crc", counts.frames.bad_crc},
                            {"unknown", counts.frames.unknown},
                            {"malformed", counts.malformed},
                            {"unsigned", counts.signatures.without},
                            {"wrong_signature", counts.signatures.wrong},
                            {"replayed", counts.signatures.replayed},
                            {"too_old", counts.signatures.too_old}};
}

void ViewBuilder::recorder(const Recorder* recorder, const std::string& trouble) {
  view_.recorder = {};
  if (recorder == nullptr) {
    view_.recorder.state = trouble.empty() ? RecorderState::off : RecorderState::failed;
    view_.recorder.reason = trouble;
    return;
  }
  const StoreStatus status = recorder->status();
  view_.recorder.state = status.stopped ? RecorderState::failed : RecorderState::recording;
  view_.recorder.reason = status.error;
  view_.recorder.written_bytes = status.bytes;
  view_.recorder.free_bytes = status.free_bytes;
  for (const auto& [topic, count] : status.dropped) view_.recorder.lost_records += count;
}

FlightView ViewBuilder::view(double now_s, std::int64_t unix_us, const std::vector<FlightEvent>& events) const {
  FlightView view = view_;
  view.time_s = now_s;
  view.utc = UtcTime{unix_us / 1'000'000};
  view.events = events;
  view.track = trail_.points();
  return view;
}

}  // namespace nadir
