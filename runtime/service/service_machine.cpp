#include "service/service_machine.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "estimation/protection_level.hpp"
#include "service/service_rules.hpp"

namespace nadir {
namespace {

using enum ServiceState;
using enum ServiceReason;

constexpr double kBurst_s = 0.1;        // closer frames are a burst, or a camera so fast that the 400 ms decide
constexpr double kMaxInterval_s = 2.5;  // longer ones are capped: too slow a camera to fly by
constexpr std::size_t kMinIntervals = 3;

const char* why_unconfirmed(ParameterCheck check) {
  switch (check) {
    case ParameterCheck::none_listed: return "the airframe file lists no parameters to compare";
    case ParameterCheck::deviating: return "its parameters are not as they were provisioned";
    default: return "its parameters have not all been compared since the start";
  }
}

}  // namespace

// ---- frame interval

void FrameIntervalMonitor::on_frame(double time_s) {
  if (!std::isfinite(time_s)) return;
  if (!last_s_) last_s_ = time_s;
  const double interval_s = time_s - *last_s_;
  if (interval_s < kBurst_s) return;
  intervals_s_[measured_++ % kKept] = std::min(interval_s, kMaxInterval_s);
  last_s_ = time_s;
}

double FrameIntervalMonitor::silence_limit_s() const {
  double usual_s = default_interval_s_, late_s = default_interval_s_;
  if (measured_ >= kMinIntervals) {
    auto sorted = intervals_s_;
    const auto end = sorted.begin() + static_cast<std::ptrdiff_t>(std::min(measured_, kKept));
    std::sort(sorted.begin(), end);
    const auto last = end - sorted.begin() - 1;
    usual_s = sorted[static_cast<std::size_t>(last / 2)];
    late_s = sorted[static_cast<std::size_t>((9 * last + 9) / 10)];
  }
  return std::max(kBlackout_s, std::min(kMissedFrames * late_s, kLatestInIntervals * usual_s));
}

std::string_view name_of(GpsVerdict verdict) {
  switch (verdict) {
    case GpsVerdict::unknown: return "unknown";
    case GpsVerdict::trusted: return "trusted";
    case GpsVerdict::denied: return "denied";
    case GpsVerdict::spoofed: return "spoofed";
  }
  return "unknown";
}

std::string_view name_of(PositionLeader leader) { return leader == PositionLeader::gps ? "gps" : "vision"; }

ServiceMachine::ServiceMachine(double now_s, const ServiceConfig& config)
    : frame_interval_(config.camera_interval_s),
      now_s_(now_s),
      since_s_(now_s),
      level_sigmas_(sigmas_of_risk(config.integrity_risk)),
      time_to_alert_s_(config.time_to_alert_s),
      usability_(config.alert_limit_m, config.time_to_alert_s),
      parameters_(config.parameters) {}

void ServiceMachine::begin_update(double now_s) {
  transitions_.clear();
  if (has_any_position()) position_s_ = now_s_;
  now_s_ = std::isfinite(now_s) ? std::max(now_s_, now_s) : now_s_;
  apply_rules();  // the effects of time come before those of a new event
}

std::vector<StateTransition> ServiceMachine::update(double now_s) {
  begin_update(now_s);
  return std::move(transitions_);
}

std::vector<StateTransition> ServiceMachine::on_event(double now_s, const OnboardEvent& event) {
  const auto input = [&](const auto& known) -> std::vector<StateTransition> {
    if constexpr (requires { on(known); }) {
      begin_update(now_s);
      on(known);
      apply_rules();
      return std::move(transitions_);
    } else {
      return {};
    }
  };
  return std::visit(input, event);
}

void ServiceMachine::apply_rules() {
  check_link();
  check_vision();
  check_level();
  while (const auto step = next_step()) enter(*step);
  choose_leader();
  if (has_any_position()) position_s_ = now_s_;
  if (state_ == ServiceState::degraded) sent_sigma_m_ = std::max(sent_sigma_m_, sigma_now_m());
  check_usability();
}

void ServiceMachine::enter(const Step& step) {
  std::string text(text_of(step.reason).explanation);
  if (!step.detail.empty()) text += ": " + step.detail;
  transitions_.push_back({now_s_, state_, step.to, step.reason, std::move(text)});
  state_ = step.to;
  if (!provides_position()) provided_s_.reset();
  if (provides_position() && !provided_s_) provided_s_ = now_s_;
  if (step.reason == integrity_lost) awaits_level_ = true;
  reason_ = step.reason;
  detail_ = step.detail;
  since_s_ = now_s_;
  if (state_ == ServiceState::normal) {
    ever_anchored_ = true;
    restored_ = false;
    return;
  }
  steady_since_s_.reset();
  sent_sigma_m_ = sigma_m_;
  if (state_ == ServiceState::no_fix) anchored_ = restored_ = false;
}

std::string ServiceMachine::reason_text() const {
  std::string detail = detail_;
  if (const auto blind = blindness(); state_ == degraded && blind && blind->reason == reason_) detail = blind->detail;
  if (reason_ == no_position && position_s_) detail = fmt::format("for {:.1f} s", now_s_ - *position_s_);
  const std::string text(text_of(reason_).explanation);
  return detail.empty() ? text : text + ": " + detail;
}

void ServiceMachine::note(ServiceReason reason, const std::string& detail) {
  std::string text(text_of(reason).explanation);
  if (!detail.empty()) text += ": " + detail;
  transitions_.push_back({now_s_, state_, state_, reason, std::move(text)});
}

void ServiceMachine::check_link() {
  if (!link_up_ || now_s_ - *heartbeat_s_ <= kLinkLost_s) return;
  link_up_ = false;
  note(ServiceReason::link_lost, fmt::format("{:.1f} s", now_s_ - *heartbeat_s_));
}

void ServiceMachine::check_vision() {
  if (blindness()) steady_since_s_.reset();
}

void ServiceMachine::check_level() {
  std::optional<double>& since_s = hpl_m_ ? level_known_s_ : level_unknown_s_;
  (hpl_m_ ? level_unknown_s_ : level_known_s_).reset();
  if (!since_s) since_s = now_s_;
  if (level_known_s_ && now_s_ - *level_known_s_ >= time_to_alert_s_) awaits_level_ = false;
}

// From the first position of the flight on: before it the operator knows that there is none.
void ServiceMachine::check_usability() {
  ever_provided_ = ever_provided_ || provides_position();
  if (!ever_provided_) return;
  const std::optional<double> level_m = level_now_m();
  const PositionUsability::Change change = usability_.update(now_s_, level_m);
  if (change == PositionUsability::Change::none) return;
  const bool lost = change == PositionUsability::Change::lost;
  note(lost ? position_not_usable : position_usable_again, !provides_position() ? "no position"
                                                           : level_m
                                                               ? fmt::format("{:.0f} m", *level_m)
                                                               : "no radius holds the position at the mission's risk");
}

void ServiceMachine::choose_leader() {
  const bool gps_is_bad = gps_ == GpsVerdict::denied || gps_ == GpsVerdict::spoofed;
  if (leader_ == PositionLeader::gps && gps_is_bad && provides_position()) {
    leader_ = PositionLeader::vision;
    vision_leads_s_ = now_s_;
  } else if (leader_ == PositionLeader::vision && gps_ == GpsVerdict::trusted) {
    leader_ = PositionLeader::gps;
    lead_note_.reset();
    note(ServiceReason::gps_leads);
  }
  if (leader_ == PositionLeader::vision) note_lead();
}

// Whether the autopilot navigates by our position is known once its parameters are compared; after a restart in flight
// that takes some seconds. What is found later is noted, too.
void ServiceMachine::note_lead() {
  if (parameters_ == ParameterCheck::pending && now_s_ - vision_leads_s_ < kParametersPending_s) return;
  const bool confirmed = parameters_ == ParameterCheck::as_provisioned;
  const ServiceReason reason = confirmed ? vision_leads : vision_leads_unconfirmed;
  if (lead_note_ == reason) return;
  lead_note_ = reason;
  const std::string gps = fmt::format("GPS is {}", name_of(gps_));
  note(reason, confirmed ? gps : fmt::format("{}, and {}", gps, why_unconfirmed(parameters_)));
}

void ServiceMachine::on(const ParametersCompared& parameters) { parameters_ = parameters.check; }

void ServiceMachine::on(const PackageVerified& package) { package_ = package; }

void ServiceMachine::on(const AutopilotHeartbeat& heartbeat) {
  if (heartbeat.authentication == LinkAuthentication::missing) {
    if (!link_up_ && !unauthenticated_peer_noted_) note(ServiceReason::link_unsigned);
    unauthenticated_peer_noted_ = true;
    return;
  }
  if (!link_up_ && heartbeat_s_) note(ServiceReason::link_back, fmt::format("after {:.1f} s", now_s_ - *heartbeat_s_));
  link_up_ = true;
  authentication_ = heartbeat.authentication;
  heartbeat_s_ = now_s_;
  unauthenticated_peer_noted_ = false;
  if (heartbeat.armed && !position_s_) position_s_ = now_s_;  // an armed aircraft needs a position
}

void ServiceMachine::on(const FrameReceived&) {
  frame_s_ = now_s_;
  frame_interval_.on_frame(now_s_);
  if (!unanswered_s_) unanswered_s_ = now_s_;
}

void ServiceMachine::on(const LocalizedFrame& frame) {
  const Estimate& estimate = frame.report.estimate;
  if (!frame_s_) frame_s_ = now_s_;
  unanswered_s_.reset();
  estimate_s_ = now_s_;
  source_ = estimate.source;
  has_position_ = source_ != SourceLabel::no_fix && std::isfinite(estimate.sigma_m) && estimate.sigma_m >= 0;
  sigma_m_ = has_position_ ? estimate.sigma_m : kNoFixAccuracy_m;
  hpl_m_.reset();
  if (has_position_ && estimate.hpl_m && std::isfinite(*estimate.hpl_m) && *estimate.hpl_m >= 0)
    hpl_m_ = estimate.hpl_m;
  growth_mps_ = kBlindGrowth_mps;

  if (!has_position_) anchored_ = false;
  const bool accepted = frame.report.anchor.verdict == AnchorVerdict::accepted;
  const AnchorVerdict verdict = frame.report.anchor.verdict;
  if (verdict != AnchorVerdict::not_tried && verdict != AnchorVerdict::frame_unfit) match_failures_ = 0;
  const bool visual = has_position_ && is_visual(source_);
  if (visual) visual_s_ = now_s_;
  if (!visual || sigma_m_ > kReturnSigma_m) {
    steady_since_s_.reset();
    return;
  }
  if (!steady_since_s_) steady_since_s_ = now_s_;
  if (source_ == SourceLabel::satellite_anchored || accepted) anchored_ = true;
}

void ServiceMachine::on(const MatchFailed&) {
  if (++match_failures_ == kMatchFailures && state_ != ServiceState::normal) note(matcher_failing);
}

void ServiceMachine::on(const EstimateRestored& restored) {
  if (estimate_s_) return;  // an estimate is newer
  restored_ = has_position_ = std::isfinite(restored.sigma_m) && restored.sigma_m >= 0;
  source_ = restored_ ? SourceLabel::dead_reckoned : SourceLabel::no_fix;
  sigma_m_ = restored_ ? restored.sigma_m : kNoFixAccuracy_m;
  growth_mps_ = std::isfinite(restored.speed_mps) ? std::max(restored.speed_mps, kBlindGrowth_mps) : kNoFixSigma_m;
  estimate_s_ = now_s_;
  hpl_m_.reset();  // what was seen before the restart is not known any more
}

void ServiceMachine::on(const GpsAssessment& gps) {
  if (gps.verdict == gps_) return;
  gps_ = gps.verdict;
  if (gps_ == GpsVerdict::denied) note(ServiceReason::gps_denied, gps.reason);
  if (gps_ == GpsVerdict::spoofed) note(ServiceReason::gps_spoofed, gps.reason);
  if (gps_ == GpsVerdict::trusted) note(ServiceReason::gps_trusted, gps.reason);
}

double ServiceMachine::sigma_now_m() const {
  return estimate_s_ ? sigma_m_ + growth_mps_ * (now_s_ - *estimate_s_) : kNoFixAccuracy_m;
}

// A level belongs to its estimate, as σ does, and grows with it: σ_b of protection_level.hpp by the growth of σ.
std::optional<double> ServiceMachine::level_now_m() const {
  if (!provides_position() || !hpl_m_ || !estimate_s_) return std::nullopt;
  if (state_ == ServiceState::normal) return hpl_m_;
  const double grown_m = *hpl_m_ + level_sigmas_ * growth_mps_ * (now_s_ - *estimate_s_);
  return std::max(grown_m, level_sigmas_ * sent_sigma_m_);
}

ServiceStatus ServiceMachine::status() const {
  ServiceStatus status{.state = state_,
                       .reason = reason_,
                       .since_s = since_s_,
                       .serves_fixes = package_verified() && heartbeat_s_.has_value(),
                       .fix = provides_position(),
                       .source = SourceLabel::no_fix,
                       .sigma_m = kNoFixAccuracy_m,
                       .leader = leader_,
                       .gps = gps_,
                       .link_up = link_up_,
                       .frame_s = frame_s_,
                       .hpl_m = level_now_m(),
                       .usable = provides_position() && usability_.usable()};
  if (state_ == ServiceState::normal) {
    status.source = source_;
    status.sigma_m = sigma_m_;
  } else if (state_ == ServiceState::degraded) {
    status.source = SourceLabel::dead_reckoned;
    status.sigma_m = sent_sigma_m_;
  }
  return status;
}

// ---- the rules of docs/onboard.md, one after the other. Nothing changes here.

std::optional<ServiceMachine::Step> ServiceMachine::next_step() const {
  if (state_ == failsafe) return step_from_failsafe();
  if (!has_any_position() && position_s_ && now_s_ - *position_s_ > kFailsafe_s) {
    return Step{failsafe, no_position, fmt::format("for {:.1f} s", now_s_ - *position_s_)};
  }
  if (package_ && !package_->accepted && state_ != no_package) {
    return Step{no_package, package_refused, package_->reason};
  }
  switch (state_) {
    case boot:
    case no_package:
      if (package_verified()) return Step{awaiting_autopilot, ServiceReason::package_verified, {}};
      return std::nullopt;
    case awaiting_autopilot:
      if (link_up_) {
        const bool is_signed = authentication_ == LinkAuthentication::signature;
        return Step{relocalizing, is_signed ? link_authentic : link_without_signing, {}};
      }
      return std::nullopt;
    case relocalizing: return step_from_search();
    case normal:
    case degraded: return step_from_fix();
    case no_fix:
      if (may_return() && steady_for(kReturnFromNoFix_s)) return Step{normal, anchored_again, {}};
      return std::nullopt;
    case failsafe: return std::nullopt;
  }
  return std::nullopt;
}

std::optional<ServiceMachine::Step> ServiceMachine::step_from_search() const {
  if (anchored_ && steady_for(0)) return Step{normal, first_anchor, {}};
  if (good_restored_position()) return Step{degraded, restored, fmt::format("σ {:.0f} m", sigma_now_m())};
  return std::nullopt;
}

std::optional<ServiceMachine::Step> ServiceMachine::step_from_fix() const {
  if (auto lost = loss()) return lost;
  auto blind = blindness();
  if (state_ == normal) return blind;
  if (!blind && anchored_ && steady_for(kReturnFromDegraded_s)) return Step{normal, vision_back, {}};
  return std::nullopt;
}

// A position of ours needs the package and an autopilot to send it to.
std::optional<ServiceMachine::Step> ServiceMachine::step_from_failsafe() const {
  const bool may_send = package_verified() && heartbeat_s_;
  if (may_send && may_return() && steady_for(ever_anchored_ ? kReturnFromFailsafe_s : 0)) {
    return Step{normal, ever_anchored_ ? anchored_again : first_anchor, {}};
  }
  if (may_send && good_restored_position()) return Step{degraded, restored, fmt::format("σ {:.0f} m", sigma_now_m())};
  if (gps_ != GpsVerdict::trusted) return std::nullopt;
  ServiceState back = ever_anchored_ ? no_fix : relocalizing;
  if (!heartbeat_s_) back = awaiting_autopilot;
  if (!package_) back = boot;
  if (package_ && !package_->accepted) back = no_package;
  return Step{back, gps_position, {}};
}

std::optional<ServiceMachine::Step> ServiceMachine::blindness() const {
  if (frame_s_ && now_s_ - *frame_s_ > frame_interval_.silence_limit_s()) {
    return Step{degraded, camera_silent, fmt::format("no frame for {:.2f} s", now_s_ - *frame_s_)};
  }
  if (unanswered_s_ && now_s_ - *unanswered_s_ > kEstimateOverdue_s) {
    return Step{degraded, localizer_late, fmt::format("no estimate for {:.2f} s", now_s_ - *unanswered_s_)};
  }
  if (match_failures_ >= kMatchFailures) {
    return Step{degraded, matcher_failing, fmt::format("{} in a row", match_failures_)};
  }
  if (source_ == SourceLabel::dead_reckoned) return Step{degraded, frame_unfit, {}};
  return std::nullopt;
}

std::optional<ServiceMachine::Step> ServiceMachine::loss() const {
  if (!has_position_) return Step{no_fix, localizer_lost, {}};
  const double sigma_m = state_ == degraded ? sigma_now_m() : sigma_m_;
  if (sigma_m > kNoFixSigma_m) {
    return Step{no_fix, sigma_too_large, fmt::format("σ {:.0f} m, at most {:.0f} m", sigma_m, kNoFixSigma_m)};
  }
  // An accuracy bounds a protection level (docs/autopilot.md). Where there is none, none can be stated. A position from
  // before a restart has none by its nature; the rules below end it.
  if (level_unknown_s_ && provided_s_ && !restored_) {
    const double unknown_s = now_s_ - std::max(*level_unknown_s_, *provided_s_);
    if (unknown_s > time_to_alert_s_) return Step{no_fix, integrity_lost, fmt::format("for {:.1f} s", unknown_s)};
  }
  const double blind_s = now_s_ - visual_s_.value_or(since_s_);
  if (state_ == degraded && blind_s > kBlindNoFix_s) {
    return Step{no_fix, blind_too_long, fmt::format("{:.1f} s, at most {:.0f} s", blind_s, kBlindNoFix_s)};
  }
  return std::nullopt;
}

bool ServiceMachine::good_restored_position() const {
  return restored_ && has_position_ && sigma_now_m() <= kNoFixSigma_m;
}

}  // namespace nadir
