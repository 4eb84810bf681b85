#include "service/service_machine.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "service/service_rules.hpp"

namespace nadir {
namespace {

bool carried_by_pictures(SourceLabel source) {
  return source == SourceLabel::satellite_anchored || source == SourceLabel::vo_extrapolated;
}

}  // namespace

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
    : pace_(config.camera_interval_s), now_s_(now_s), since_s_(now_s) {}

std::vector<ServiceEvent> ServiceMachine::update(double now_s, std::span<const ServiceFact> facts) {
  events_.clear();
  if (position_held()) held_s_ = now_s_;
  now_s_ = std::isfinite(now_s) ? std::max(now_s_, now_s) : now_s_;
  settle();  // what time alone has done comes before what is new
  for (const ServiceFact& fact : facts) {
    std::visit([this](const auto& known) { learn(known); }, fact);
    settle();
  }
  return std::move(events_);
}

void ServiceMachine::settle() {
  look_at_link();
  look_at_vision();
  while (const auto step = next_step()) enter(*step);
  choose_leader();
  if (position_held()) held_s_ = now_s_;
  if (state_ == ServiceState::degraded) told_sigma_m_ = std::max(told_sigma_m_, sigma_now_m());
}

void ServiceMachine::enter(const Step& step) {
  std::string text(text_of(step.reason).explanation);
  if (!step.detail.empty()) text += ": " + step.detail;
  events_.push_back({now_s_, state_, step.to, step.reason, std::move(text)});
  state_ = step.to;
  reason_ = step.reason;
  since_s_ = now_s_;
  if (state_ == ServiceState::normal) {
    ever_anchored_ = true;
    restored_ = false;
    return;
  }
  steady_since_s_.reset();
  told_sigma_m_ = sigma_m_;
  if (state_ == ServiceState::no_fix) anchored_ = restored_ = false;
}

void ServiceMachine::note(ServiceReason reason, const std::string& detail) {
  std::string text(text_of(reason).explanation);
  if (!detail.empty()) text += ": " + detail;
  events_.push_back({now_s_, state_, state_, reason, std::move(text)});
}

void ServiceMachine::look_at_link() {
  if (!link_up_ || now_s_ - *heard_s_ <= kLinkLost_s) return;
  link_up_ = false;
  note(ServiceReason::link_lost, fmt::format("{:.1f} s", now_s_ - *heard_s_));
}

void ServiceMachine::look_at_vision() {
  if (blindness()) steady_since_s_.reset();
}

void ServiceMachine::choose_leader() {
  const bool gps_is_bad = gps_ == GpsVerdict::denied || gps_ == GpsVerdict::spoofed;
  if (leader_ == PositionLeader::gps && gps_is_bad && tells_position()) {
    leader_ = PositionLeader::vision;
    note(ServiceReason::vision_leads, fmt::format("GPS is {}", name_of(gps_)));
  } else if (leader_ == PositionLeader::vision && gps_ == GpsVerdict::trusted) {
    leader_ = PositionLeader::gps;
    note(ServiceReason::gps_leads);
  }
}

void ServiceMachine::learn(const PackageJudged& package) { package_ = package; }

void ServiceMachine::learn(const AutopilotHeard& heard) {
  if (!heard.authentic) {
    if (!link_up_ && !stranger_noted_) note(ServiceReason::link_unsigned);
    stranger_noted_ = true;
    return;
  }
  if (!link_up_ && heard_s_) note(ServiceReason::link_back, fmt::format("after {:.1f} s", now_s_ - *heard_s_));
  link_up_ = true;
  heard_s_ = now_s_;
  stranger_noted_ = false;
  if (heard.armed && !held_s_) held_s_ = now_s_;  // whoever flies should have a position
}

void ServiceMachine::learn(const FrameArrived&) {
  frame_s_ = now_s_;
  pace_.picture(now_s_);
  if (!unanswered_s_) unanswered_s_ = now_s_;
}

void ServiceMachine::learn(const EstimateMade& estimate) {
  if (!frame_s_) frame_s_ = now_s_;
  unanswered_s_.reset();
  estimate_s_ = now_s_;
  source_ = estimate.source;
  has_position_ = source_ != SourceLabel::no_fix && std::isfinite(estimate.sigma_m) && estimate.sigma_m >= 0;
  sigma_m_ = has_position_ ? estimate.sigma_m : kNoFixAccuracy_m;
  growth_m_per_s_ = kBlindGrowth_m_per_s;

  if (!has_position_) anchored_ = false;
  const bool seen = has_position_ && carried_by_pictures(source_);
  if (seen) seen_s_ = now_s_;
  if (!seen || sigma_m_ > kReturnSigma_m) {
    steady_since_s_.reset();
    return;
  }
  if (!steady_since_s_) steady_since_s_ = now_s_;
  if (source_ == SourceLabel::satellite_anchored || estimate.anchored) anchored_ = true;
}

void ServiceMachine::learn(const EstimateRestored& restored) {
  if (estimate_s_) return;  // the localizer knows better by now
  restored_ = has_position_ = std::isfinite(restored.sigma_m) && restored.sigma_m >= 0;
  source_ = restored_ ? SourceLabel::dead_reckoned : SourceLabel::no_fix;
  sigma_m_ = restored_ ? restored.sigma_m : kNoFixAccuracy_m;
  growth_m_per_s_ =
      std::isfinite(restored.speed_m_per_s) ? std::max(restored.speed_m_per_s, kBlindGrowth_m_per_s) : kNoFixSigma_m;
  estimate_s_ = now_s_;
}

void ServiceMachine::learn(const GpsJudged& gps) {
  if (gps.verdict == gps_) return;
  gps_ = gps.verdict;
  if (gps_ == GpsVerdict::denied) note(ServiceReason::gps_denied, gps.why);
  if (gps_ == GpsVerdict::spoofed) note(ServiceReason::gps_spoofed, gps.why);
  if (gps_ == GpsVerdict::trusted) note(ServiceReason::gps_trusted, gps.why);
}

double ServiceMachine::sigma_now_m() const {
  return estimate_s_ ? sigma_m_ + growth_m_per_s_ * (now_s_ - *estimate_s_) : kNoFixAccuracy_m;
}

ServiceStatus ServiceMachine::status() const {
  ServiceStatus status{.state = state_,
                       .reason = reason_,
                       .since_s = since_s_,
                       .serves_fixes = package_verified() && heard_s_.has_value(),
                       .fix = tells_position(),
                       .source = SourceLabel::no_fix,
                       .sigma_m = kNoFixAccuracy_m,
                       .leader = leader_,
                       .gps = gps_,
                       .link_up = link_up_};
  if (state_ == ServiceState::normal) {
    status.source = source_;
    status.sigma_m = sigma_m_;
  } else if (state_ == ServiceState::degraded) {
    status.source = SourceLabel::dead_reckoned;
    status.sigma_m = told_sigma_m_;
  }
  return status;
}

}  // namespace nadir
