// Which state follows: the rules of docs/onboard.md, one after the other. Nothing is changed here.
#include <fmt/format.h>

#include "service/service_machine.hpp"
#include "service/service_rules.hpp"

namespace nadir {

using enum ServiceState;
using enum ServiceReason;

std::optional<ServiceMachine::Step> ServiceMachine::next_step() const {
  if (state_ == failsafe) return step_from_failsafe();
  if (!position_held() && held_s_ && now_s_ - *held_s_ > kFailsafe_s) {
    return Step{failsafe, no_position, fmt::format("for {:.1f} s", now_s_ - *held_s_)};
  }
  if (package_ && !package_->verified && state_ != no_package) {
    return Step{no_package, package_refused, package_->why};
  }
  switch (state_) {
    case boot:
    case no_package:
      if (package_verified()) return Step{awaiting_autopilot, ServiceReason::package_verified, {}};
      return std::nullopt;
    case awaiting_autopilot:
      if (link_up_) return Step{relocalizing, link_authentic, {}};
      return std::nullopt;
    case relocalizing: return step_from_search();
    case normal:
    case degraded: return step_from_fix();
    case no_fix:
      if (anchored_ && steady_for(kReturnFromNoFix_s)) return Step{normal, anchored_again, {}};
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

// A position of ours needs what every position needs: the package, and somebody to tell.
std::optional<ServiceMachine::Step> ServiceMachine::step_from_failsafe() const {
  const bool may_tell = package_verified() && heard_s_;
  if (may_tell && anchored_ && steady_for(ever_anchored_ ? kReturnFromFailsafe_s : 0)) {
    return Step{normal, ever_anchored_ ? anchored_again : first_anchor, {}};
  }
  if (may_tell && good_restored_position()) return Step{degraded, restored, fmt::format("σ {:.0f} m", sigma_now_m())};
  if (gps_ != GpsVerdict::trusted) return std::nullopt;
  ServiceState back = ever_anchored_ ? no_fix : relocalizing;
  if (!heard_s_) back = awaiting_autopilot;
  if (!package_) back = boot;
  if (package_ && !package_->verified) back = no_package;
  return Step{back, gps_position, {}};
}

std::optional<ServiceMachine::Step> ServiceMachine::blindness() const {
  if (frame_s_ && now_s_ - *frame_s_ > pace_.silence_limit_s()) {
    return Step{degraded, camera_silent, fmt::format("no picture for {:.2f} s", now_s_ - *frame_s_)};
  }
  if (unanswered_s_ && now_s_ - *unanswered_s_ > kEstimateOverdue_s) {
    return Step{degraded, localizer_late, fmt::format("no estimate for {:.2f} s", now_s_ - *unanswered_s_)};
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
  const double blind_s = now_s_ - seen_s_.value_or(since_s_);
  if (state_ == degraded && blind_s > kBlindNoFix_s) {
    return Step{no_fix, blind_too_long, fmt::format("{:.1f} s, at most {:.0f} s", blind_s, kBlindNoFix_s)};
  }
  return std::nullopt;
}

bool ServiceMachine::good_restored_position() const {
  return restored_ && has_position_ && sigma_now_m() <= kNoFixSigma_m;
}

}  // namespace nadir
