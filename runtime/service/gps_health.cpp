#include "service/gps_health.hpp"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "geodesy/local_frame.hpp"

namespace nadir {
namespace {

double distance_m(LonLat from, LonLat to) { return distance_m(LocalFrame(from).plane_from_lonlat(to), {}); }

bool valid(LonLat place) {
  return std::abs(place.lat_deg) <= 90 && std::abs(place.lon_deg) <= 180;  // false for NaN
}

double sigma_of(const GpsFix3d& fix) {
  const double reported_m = fix.accuracy_m.value_or(kDefaultGpsSigma_m);
  return reported_m >= 0 ? std::min(reported_m, kMaxGpsSigma_m) : kDefaultGpsSigma_m;
}

double speed_of(const GpsFix3d& fix) {
  const double reported_mps = fix.ground_speed_mps.value_or(kMaxGroundSpeed_mps);
  return reported_mps >= 0 ? std::min(reported_mps, kMaxGroundSpeed_mps) : kMaxGroundSpeed_mps;
}

bool lasts(double now_s, const std::optional<double>& since_s, double limit_s) {
  return since_s && now_s - *since_s > limit_s;
}

}  // namespace

void GpsHealth::on_event(const GpsFix3d& fix) {
  last_message_s_ = std::max(last_message_s_, fix.time_s);
  if (!fix.has_fix || !valid(fix.place)) {
    if (!no_fix_since_s_) no_fix_since_s_ = fix.time_s;
    reset_stability();
    return;
  }
  if (last_fix_ && fix.time_s <= last_fix_->time_s) return;
  no_fix_since_s_.reset();
  check_step(fix);
  if (!good_since_s_) good_since_s_ = fix.time_s;
  compare_with_vision(fix);
  last_fix_ = fix;
}

void GpsHealth::check_step(const GpsFix3d& fix) {
  if (fix.ground_speed_mps && *fix.ground_speed_mps > kMaxGroundSpeed_mps) {
    fault_ = fmt::format("ground speed {:.0f} m/s", *fix.ground_speed_mps);
    reset_stability();
  }
  if (!last_fix_) return;
  const double dt_s = fix.time_s - last_fix_->time_s;
  const double moved_m = distance_m(last_fix_->place, fix.place);
  const double speed_mps = std::max(speed_of(*last_fix_), speed_of(fix)) + kMaxAcceleration_mps2 * dt_s / 2;
  const double flown_m = std::min(speed_mps, kMaxGroundSpeed_mps) * dt_s;
  if (moved_m <= flown_m + kStepMargin_m + 3 * (sigma_of(*last_fix_) + sigma_of(fix))) return;
  fault_ = fmt::format("a step of {:.0f} m in {:.1f} s", moved_m, dt_s);
  reset_stability();
}

void GpsHealth::compare_with_vision(const GpsFix3d& fix) {
  if (!vision_available(fix.time_s)) {
    agrees_since_s_.reset();
    disagrees_since_s_.reset();
    return;
  }
  const double dt_s = fix.time_s - vision_->time_s;
  const Eigen::Vector2d& velocity_mps = vision_->velocity_mps;
  const Eigen::Vector2d difference_m =
      LocalFrame(vision_->place).plane_from_lonlat(fix.place).vector() - velocity_mps * dt_s;
  const double gps_sigma_m = std::max(sigma_of(fix), kMinGpsSigma_m), moved_m = vision_->velocity_sigma_mps * dt_s;
  const Eigen::Matrix2d covariance_m2 = vision_->covariance_m2 +
                                        (gps_sigma_m * gps_sigma_m + moved_m * moved_m) * Eigen::Matrix2d::Identity() +
                                        kGpsTimeSigma_s * kGpsTimeSigma_s * velocity_mps * velocity_mps.transpose();
  const double chi2 = difference_m.dot(covariance_m2.inverse() * difference_m);
  apart_m_ = difference_m.norm();
  const auto mark = [&](bool holds, std::optional<double>& since_s) {
    if (!holds) since_s.reset();
    if (holds && !since_s) since_s = fix.time_s;
  };
  mark(chi2 <= kAgreementChi2, agrees_since_s_);
  mark(chi2 > kDisagreementChi2, disagrees_since_s_);
}

void GpsHealth::on_event(const EkfReport& report) {
  if (report.has_position) {
    ekf_had_position_ = true;
    ekf_lost_since_s_.reset();
  } else if (ekf_had_position_ && !ekf_lost_since_s_) {
    ekf_lost_since_s_ = report.time_s;
  }
  if (!report.gps_glitch) {
    glitch_since_s_.reset();
  } else if (!glitch_since_s_) {
    glitch_since_s_ = report.time_s;
  }
}

void GpsHealth::on_event(const LocalizedFrame& frame) {
  const Estimate& estimate = frame.report.estimate;
  if (estimate.position && is_visual(estimate.source)) {
    const StateEstimate& state = frame.report.state;
    on_vision({frame.telemetry.time_s, *estimate.position, estimate.covariance_m2, state.velocity_mps,
               state.velocity_sigma_mps});
  }
}

void GpsHealth::on_vision(const VisionPosition& vision) {
  const double variance_m2 = vision.covariance_m2.trace() / 2;  // one axis; the comparisons are false for NaN
  const bool known = variance_m2 >= 0 && variance_m2 <= kMaxVisionSigma_m * kMaxVisionSigma_m;
  if (valid(vision.place) && known && vision.covariance_m2.allFinite() && vision.velocity_mps.allFinite() &&
      std::isfinite(vision.velocity_sigma_mps)) {
    vision_ = vision;
  }
}

void GpsHealth::reset_stability() {
  good_since_s_.reset();
  agrees_since_s_.reset();
  disagrees_since_s_.reset();
}

bool GpsHealth::vision_available(double time_s) const {
  return vision_ && std::abs(time_s - vision_->time_s) <= kMaxVisionAge_s;
}

// While and soon after the autopilot's filter uses a fix of ours, its alarms are not about the receiver.
bool GpsHealth::filter_uses_receiver(double now_s) const { return !our_fix_s_ || now_s - *our_fix_s_ > kOurFixInUse_s; }

std::optional<GpsAssessment> GpsHealth::find_fault(double now_s) const {
  using enum GpsVerdict;
  if (!fault_.empty()) return GpsAssessment{spoofed, fault_};
  if (now_s - last_message_s_ > kGpsSilent_s) {
    return GpsAssessment{denied, fmt::format("no message from the receiver for {:.1f} s", now_s - last_message_s_)};
  }
  if (lasts(now_s, no_fix_since_s_, kGpsNoFix_s)) return GpsAssessment{denied, "the receiver has no fix"};
  if (lasts(now_s, disagrees_since_s_, kDisagreement_s)) {
    return GpsAssessment{spoofed, fmt::format("{:.0f} m from the visual position", apart_m_)};
  }
  // With GPS already out of use, the filter follows our fix.
  if (assessment_.verdict != GpsVerdict::trusted || !filter_uses_receiver(now_s)) return std::nullopt;
  if (lasts(now_s, glitch_since_s_, kEkfAlarm_s)) return GpsAssessment{spoofed, "the autopilot reports a GPS glitch"};
  if (lasts(now_s, ekf_lost_since_s_, kEkfAlarm_s)) {
    return GpsAssessment{denied, "the autopilot has lost its GPS position"};
  }
  return std::nullopt;
}

bool GpsHealth::trustworthy_again(double now_s) const {
  if (!good_since_s_) return false;
  if (assessment_.verdict == GpsVerdict::unknown) return true;  // nothing contradicts the first one
  // The alarm would make it spoofed at once.
  if (filter_uses_receiver(now_s) && lasts(now_s, glitch_since_s_, kEkfAlarm_s)) return false;
  if (agrees_since_s_ && now_s - *good_since_s_ >= kGpsStable_s && now_s - *agrees_since_s_ >= kGpsStable_s)
    return true;
  const double alone_s = had_first_fix_ ? kGpsStableAlone_s : kGpsFirst_s;
  return !spoofed_ && !vision_available(now_s) && now_s - *good_since_s_ >= alone_s;
}

GpsAssessment GpsHealth::assess(double now_s, bool link_up) {
  if (!link_up) {
    last_message_s_ = std::max(last_message_s_, now_s);
    return assessment_;
  }
  if (auto found = find_fault(now_s)) {
    fault_.clear();
    reset_stability();
    const bool spoofed = found->verdict == GpsVerdict::spoofed;
    spoofed_ = spoofed_ || spoofed;
    // A spoofed receiver that then falls silent stays spoofed.
    if (spoofed || assessment_.verdict == GpsVerdict::trusted || assessment_.verdict == GpsVerdict::unknown)
      assessment_ = *found;
  } else if (assessment_.verdict != GpsVerdict::trusted && trustworthy_again(now_s)) {
    assessment_ = {GpsVerdict::trusted, spoofed_ ? "stable, agrees with vision" : "stable"};
    spoofed_ = false;
    had_first_fix_ = true;
  }
  return assessment_;
}

bool GpsHints::due(LonLat place, bool position_known) {
  if (last_) {
    if (position_known) return false;
    if (!(distance_m(*last_, place) >= kGpsHintRadius_m / 2)) return false;
  }
  last_ = place;
  return true;
}

}  // namespace nadir
