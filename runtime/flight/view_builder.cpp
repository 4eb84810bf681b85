#include "flight/view_builder.hpp"

#include "service/service_rules.hpp"

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

void ViewBuilder::set_integrity(const IntegrityRequirement& integrity) {
  view_.integrity.risk = integrity.risk;
  view_.integrity.alert_limit_m = integrity.alert_limit_m;
  view_.integrity.time_to_alert_s = integrity.time_to_alert_s;
}

void ViewBuilder::on_event(const LocalizedFrame& frame) {
  const Estimate& estimate = frame.report.estimate;
  const StateEstimate& state = frame.report.state;
  const AnchorVerdict verdict = frame.report.anchor.verdict;
  view_.position.reset();
  if (estimate.position) {
    const auto& p = estimate.covariance_m2;
    view_.position = PositionView{*estimate.position, estimate.sigma_m,      p(0, 0), p(1, 1), p(0, 1),
                                  estimate.hpl_m,     frame.telemetry.time_s};
    trail_.add({frame.telemetry.time_s, *estimate.position, estimate.sigma_m, estimate.source});
  }
  view_.source = estimate.source;
  // Kept when tracking is lost: the time since the last match goes on.
  if (estimate.anchor_age_s) view_.anchored_s = frame.telemetry.time_s - *estimate.anchor_age_s;
  view_.heading_rad = state.heading_rad;
  view_.pitch_rad = frame.telemetry.pitch_rad;
  view_.roll_rad = frame.telemetry.roll_rad;
  view_.velocity = VelocityView{state.velocity_mps.x(), state.velocity_mps.y()};
  view_.agl_m = state.agl_m;
  if (verdict == AnchorVerdict::accepted) ++view_.anchors.accepted;
  if (verdict != AnchorVerdict::accepted && verdict != AnchorVerdict::not_tried) {
    ++view_.anchors.rejected;
    ++view_.anchors.rejected_by[std::string(name_of(verdict))];
  }
}

void ViewBuilder::on_event(const GpsAssessment& gps) { view_.gps = {shown(gps.verdict), gps.reason}; }

void ViewBuilder::set_status(const ServiceStatus& status, const std::string& reason) {
  view_.state = {status.state, reason, status.since_s};
  view_.integrity.usable = status.usable;
  view_.frames.last_s = status.frame_s;
}

void ViewBuilder::restrict_to_fix(const ServiceStatus& status, const std::optional<Fix>& last_fix, double now_s) {
  if (status.state == ServiceState::normal) return;
  view_.position.reset();
  view_.velocity.reset();
  view_.heading_rad = view_.pitch_rad = view_.roll_rad = view_.agl_m = std::nullopt;  // of the last frame
  if (attitude_ && now_s - *attitude_s_ < kLinkLost_s) {
    view_.heading_rad = attitude_->yaw_rad;
    view_.pitch_rad = attitude_->pitch_rad;
    view_.roll_rad = attitude_->roll_rad;
  }
  view_.source = SourceLabel::no_fix;
  if (status.state != ServiceState::degraded || !last_fix) return;
  const double variance_m2 = last_fix->sigma_m * last_fix->sigma_m;
  view_.position = PositionView{last_fix->place, last_fix->sigma_m, variance_m2, variance_m2, 0, status.hpl_m, now_s};
  view_.source = SourceLabel::dead_reckoned;
  if (last_fix->velocity) view_.velocity = VelocityView{last_fix->velocity->east_mps, last_fix->velocity->north_mps};
  trail_.add({now_s, last_fix->place, last_fix->sigma_m, view_.source});
}

void ViewBuilder::set_frames(const MailboxCounts& counts, double now_s) {
  view_.frames.received = counts.put;
  view_.frames.dropped = counts.dropped;
  if (now_s - rate_since_s_ < kRateWindow_s) return;
  view_.frames.per_s = static_cast<double>(counts.put - rate_from_) / (now_s - rate_since_s_);
  rate_since_s_ = now_s;
  rate_from_ = counts.put;
}

void ViewBuilder::set_link(const AutopilotLink::State& state, bool connected, bool is_signed) {
  const LinkCounts& counts = state.counts;
  view_.link.connected = connected;
  view_.link.reason = connected ? std::string() : AutopilotLink::why_silent(state, is_signed);
  view_.link.last_message_s = state.last_message_s;
  attitude_ = state.attitude;
  attitude_s_ = state.attitude_s;
  view_.link.signed_frames = is_signed;
  view_.link.fixes_sent = state.fixes_sent;
  view_.link.rivals = counts.rivals;
  view_.link.stations.clear();
  for (const AutopilotLink::State::Station& station : state.stations) {
    view_.link.stations.push_back(
        {std::string(name_of(station.role)), station.endpoint, station.open, station.sent, station.commands});
  }
  view_.link.rejected_by = {{"bad_crc", counts.frames.bad_crc},
                            {"unknown", counts.frames.unknown},
                            {"malformed", counts.malformed},
                            {"unsigned", counts.signatures.without},
                            {"wrong_signature", counts.signatures.wrong},
                            {"replayed", counts.signatures.replayed},
                            {"too_old", counts.signatures.too_old},
                            {"too_new", counts.signatures.too_new}};
}

void ViewBuilder::set_recorder(const Recorder* recorder, const std::string& error) {
  view_.recorder = {};
  if (recorder == nullptr) {
    view_.recorder.state = error.empty() ? RecorderState::off : RecorderState::failed;
    view_.recorder.reason = error;
    return;
  }
  const StoreStatus status = recorder->status();
  view_.recorder.state = status.stopped ? RecorderState::failed : RecorderState::recording;
  view_.recorder.reason = status.error;
  view_.recorder.written_bytes = status.bytes;
  view_.recorder.free_bytes = status.free_bytes;
  for (const auto& [topic, count] : status.dropped) view_.recorder.lost_records += count;
}

FlightView ViewBuilder::view(double now_s, std::int64_t unix_us, const EventRing& events,
                             const EventRing& alarms) const {
  FlightView view = view_;
  view.time_s = now_s;
  view.utc = UtcTime{unix_us / 1'000'000};
  view.events = events.events();
  view.events_gone = events.gone();
  view.alarms = alarms.events();
  view.track = trail_.points();
  return view;
}

}  // namespace nadir
