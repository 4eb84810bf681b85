#include "flight/flight_service.hpp"

#include <fmt/format.h>

#include <cmath>
#include <utility>

#include "service/cadence.hpp"
#include "service/service_rules.hpp"

namespace nadir {
namespace {

constexpr double kTurn_s = 0.05, kPublishPeriod_s = 0.2;

}  // namespace

void FlightService::run() {
  const auto restored = restart_.position;
  journal_->note(clock_.monotonic_s(), EventSeverity::info, "state", restart_.reason);
  if (!recorder_trouble_.empty()) {
    journal_->note(clock_.monotonic_s(), EventSeverity::critical, "recorder", recorder_trouble_);
  }
  note_cautions();
  update(clock_.monotonic_s(), std::array<ServiceFact, 1>{PackageJudged{ground_ != nullptr, refusal_}});
  if (restored && restored->sigma_m <= kNoFixSigma_m) {
    update(clock_.monotonic_s(), std::array<ServiceFact, 1>{EstimateRestored{restored->sigma_m, restored->speed_m_s}});
  }
  manager_.ready(ground_ ? "flying" : "the package was refused: " + refusal_);
  Watchdog watchdog(watch_, manager_, read_service_environment().watchdog_interval_s, clock_.monotonic_s());
  Cadence publishing(kPublishPeriod_s, clock_.monotonic_s()), saving(kSavePeriod_s, clock_.monotonic_s());
  double next_s = clock_.monotonic_s();
  while (clock_.wait_until(next_s, stop_.token())) {
    const double now_s = clock_.monotonic_s();
    next_s = now_s + kTurn_s;
    while (const auto news = news_.try_take()) take(*news);
    if (const auto hint = hints_.take()) learn(now_s, PlaceHinted{hint->place, hint->radius_m, "API"});
    judge_gps(now_s);
    update(now_s, {});
    if (publishing.due(now_s)) publish(now_s);
    if (saving.due(now_s)) save(now_s);
    if (const auto late = watchdog.tick(now_s)) {
      journal_->note(now_s, late->empty() ? EventSeverity::info : EventSeverity::critical, "thread",
                     late->empty() ? "all threads are alive again" : *late);
    }
  }
  manager_.stopping("stopping");
  sum_up();
}

void FlightService::note_cautions() {
  for (const Finding& finding : cautions_.items()) {
    if (finding.severity != Severity::warning) continue;
    journal_->note(clock_.monotonic_s(), EventSeverity::warning, "finding",
                   finding.code + ": " + finding.where + ": " + finding.found);
  }
  if (cautions_.contains("airframe.unsigned")) untold_.add(TextSeverity::warning, "Nadir: airframe file is not signed");
  if (options_.tile_key && !options_.candidates)
    untold_.add(TextSeverity::warning, "Nadir: tile key not accepted, no tiles");
}

void FlightService::sum_up() {
  if (const std::size_t untold = untold_.waiting() + untold_.dropped(); untold > 0) {
    journal_->note(clock_.monotonic_s(), EventSeverity::info, "operator",
                   fmt::format("{} texts found nobody who heard them", untold));
  }
  const AutopilotLink::State link = link_->state();
  const MailboxCounts pictures = picture_counts();
  journal_->note(clock_.monotonic_s(), EventSeverity::info, "summary",
                 fmt::format("{} pictures, {} dropped; picture to fix p50 {:.0f}, p95 {:.0f}, max {:.0f} ms; {} fixes, "
                             "longest pause {:.0f} ms",
                             pictures.put, pictures.dropped, 1000 * link.latency.quantile_s(0.5),
                             1000 * link.latency.quantile_s(0.95), 1000 * link.latency.largest_s(), link.fixes_sent,
                             1000 * link.longest_gap_s));
}

// Those that the camera's thread left out never saw the mailbox.
MailboxCounts FlightService::picture_counts() const {
  MailboxCounts counts = pictures_.counts();
  const std::uint64_t left_out = camera_ ? camera_->left_out() : 0;
  counts.put += left_out;
  counts.dropped += left_out;
  return counts;
}

std::string FlightService::summary() const { return journal_->events().events().back().text; }

void FlightService::take(const TimedNews& timed) {
  std::visit([&](const auto& news) { learn(timed.time_s, news); }, timed.news);
}

void FlightService::learn(double time_s, const AutopilotEvent& spoke) {
  update(time_s, std::array<ServiceFact, 1>{AutopilotHeard{spoke.authentic, spoke.armed}});
}

void FlightService::learn(double time_s, const CameraEvent& spoke) {
  if (spoke.frame) {
    update(time_s, std::array<ServiceFact, 1>{FrameArrived{}});
  } else {
    journal_->note(time_s, EventSeverity::warning, "camera", spoke.trouble);
  }
}

void FlightService::learn(double time_s, const LocalizerEvent& spoke) {
  last_spoke_ = spoke;
  views_.localizer(spoke);
  const Estimate& estimate = spoke.estimate;
  if (estimate.position &&
      (estimate.source == SourceLabel::satellite_anchored || estimate.source == SourceLabel::vo_extrapolated)) {
    gps_.hear(VisionPosition{spoke.taken_s, *estimate.position, estimate.sigma_m});
  }
  update(time_s, std::array<ServiceFact, 1>{
                     EstimateMade{estimate.source, estimate.sigma_m, spoke.verdict == AnchorVerdict::accepted}});
}

void FlightService::learn(double time_s, const StateNotSaved& state) {
  journal_->note(time_s, EventSeverity::warning, "state directory", state.trouble);
}

void FlightService::learn(double time_s, const TilesNotMade& tiles) {
  journal_->note(time_s, EventSeverity::warning, "candidate tiles", tiles.trouble);
}

void FlightService::learn(double time_s, const FixJumped& jumped) {
  const std::string text = fmt::format("position jumps by {:.0f} m", jumped.metres);
  journal_->note(time_s, EventSeverity::warning, "fix", text);
  link_->tell(TextSeverity::warning, text);
}

void FlightService::learn(double time_s, const PlaceHinted& hinted) {
  if (localizing_) localizing_->hint(hinted.place, hinted.radius_m, hinted.by);
  journal_->note(time_s, EventSeverity::info, "hint",
                 fmt::format("{}: within {:.0f} m of {:.5f}, {:.5f}", hinted.by, hinted.radius_m, hinted.place.lat_deg,
                             hinted.place.lon_deg));
}

void FlightService::learn(double time_s, const GpsFix3d& fix) {
  gps_.hear(fix);
  // While it is trusted it says where to look first; never where we are.
  if (gps_judged_.verdict != GpsVerdict::trusted || !fix.has_fix) return;
  const bool position_known = last_spoke_ && last_spoke_->estimate.position;
  if (gps_hints_.due(fix.place, position_known)) learn(time_s, PlaceHinted{fix.place, kGpsHintRadius_m, "GPS"});
}

void FlightService::learn(double, const EkfReport& report) { gps_.hear(report); }

void FlightService::judge_gps(double now_s) {
  const ServiceStatus status = machine_.status();
  if (status.fix) gps_.led(now_s);
  const GpsJudged judged = gps_.judge(now_s, status.link_up);
  if (judged.verdict == gps_judged_.verdict) return;
  gps_judged_ = judged;
  views_.gps(judged);
  update(now_s, std::array<ServiceFact, 1>{judged});
}

void FlightService::update(double now_s, std::span<const ServiceFact> facts) {
  for (const ServiceEvent& event : machine_.update(now_s, facts)) {
    journal_->state(event);
    if (event.from != event.to) last_reason_ = event.text;
    const ReasonText& text = text_of(event.reason);
    const auto severity = static_cast<TextSeverity>(text.severity);  // both are MAVLink's numbers
    if (event.reason == ServiceReason::link_unsigned) {
      link_->tell(severity, std::string(text.operator_text));  // who has no key may hear it now; later it is of no use
    } else {
      untold_.add(severity, std::string(text.operator_text));
    }
    manager_.status(event.text);
  }
  const ServiceStatus status = machine_.status();
  link_->permit(status);
  if (!status.link_up) return;
  untold_.tell([this](TextSeverity severity, const std::string& text) { link_->tell(severity, text); });
}

void FlightService::publish(double now_s) {
  const ServiceStatus status = machine_.status();
  views_.status(status, last_reason_);
  views_.frames(picture_counts(), now_s);
  const AutopilotLink::State link = link_->state();
  views_.link(link, status.link_up, options_.link_key.has_value());
  views_.recorder(recorder_.get(), recorder_trouble_);
  views_.permit(status, link.told, now_s);
  board_.publish(views_.view(now_s, clock_.unix_us(), journal_->events().events()));
}

void FlightService::save(double now_s) {
  SavedFlight flight;
  flight.boot_id = clock_.boot_id();
  flight.saved_monotonic_s = now_s;
  flight.saved_unix_us = clock_.unix_us();
  flight.state = machine_.status().state;
  if (last_spoke_ && last_spoke_->estimate.position) {
    const Estimate& estimate = last_spoke_->estimate;
    flight.estimate =
        SavedEstimate{last_spoke_->taken_s,
                      clock_.unix_us() - std::llround((now_s - last_spoke_->taken_s) * 1e6),
                      *estimate.position,
                      estimate.sigma_m,
                      last_spoke_->belief.velocity_mps.norm(),
                      estimate.source,
                      estimate.segment,
                      SavedVelocity{last_spoke_->belief.velocity_mps.x(), last_spoke_->belief.velocity_mps.y()}};
  }
  if (options_.start) flight.hint = SavedHint{*options_.start, kGpsHintRadius_m};
  to_save_.put(std::move(flight));
}

}  // namespace nadir
