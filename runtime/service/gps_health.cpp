#include "service/gps_health.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "geodesy/local_frame.hpp"

namespace nadir {
namespace {

double distance_m(LonLat from, LonLat to) {
  const Enu to_there = LocalFrame(from).enu_from_lonlat(to);
  return std::hypot(to_there.east_m, to_there.north_m);
}

bool sound(LonLat place) {
  return std::abs(place.lat_deg) <= 90 && std::abs(place.lon_deg) <= 180;  // false for NaN
}

double sigma_of(const GpsFix3d& fix) {
  const double told_m = fix.accuracy_m.value_or(kDefaultGpsSigma_m);
  return told_m >= 0 ? std::min(told_m, kMaxGpsSigma_m) : kDefaultGpsSigma_m;
}

double speed_of(const GpsFix3d& fix) {
  const double told_m_s = fix.ground_speed_m_s.value_or(kMaxGroundSpeed_m_s);
  return told_m_s >= 0 ? std::min(told_m_s, kMaxGroundSpeed_m_s) : kMaxGroundSpeed_m_s;
}

bool lasts(double now_s, const std::optional<double>& since_s, double limit_s) {
  return since_s && now_s - *since_s > limit_s;
}

}  // namespace

void GpsHealth::hear(const GpsFix3d& fix) {
  last_message_s_ = std::max(last_message_s_, fix.time_s);
  if (!fix.has_fix || !sound(fix.place)) {
    if (!no_fix_since_s_) no_fix_since_s_ = fix.time_s;
    disturb();
    return;
  }
  if (last_fix_ && fix.time_s <= last_fix_->time_s) return;
  no_fix_since_s_.reset();
  look_for_step(fix);
  if (!good_since_s_) good_since_s_ = fix.time_s;
  compare_with_vision(fix);
  last_fix_ = fix;
}

void GpsHealth::look_for_step(const GpsFix3d& fix) {
  if (fix.ground_speed_m_s && *fix.ground_speed_m_s > kMaxGroundSpeed_m_s) {
    lie_ = fmt::format("ground speed {:.0f} m/s", *fix.ground_speed_m_s);
    disturb();
  }
  if (!last_fix_) return;
  const double dt_s = fix.time_s - last_fix_->time_s;
  const double moved_m = distance_m(last_fix_->place, fix.place);
  const double speed_m_s = std::max(speed_of(*last_fix_), speed_of(fix)) + kMaxAcceleration_m_s2 * dt_s / 2;
  const double flown_m = std::min(speed_m_s, kMaxGroundSpeed_m_s) * dt_s;
  if (moved_m <= flown_m + kStepMargin_m + 3 * (sigma_of(*last_fix_) + sigma_of(fix))) return;
  lie_ = fmt::format("a step of {:.0f} m in {:.1f} s", moved_m, dt_s);
  disturb();
}

void GpsHealth::compare_with_vision(const GpsFix3d& fix) {
  if (!vision_speaks(fix.time_s)) {
    agrees_since_s_.reset();
    disagrees_since_s_.reset();
    return;
  }
  const double apart_m = distance_m(vision_->place, fix.place);
  const double both_sigma_m = std::hypot(sigma_of(fix), vision_->sigma_m);
  const double allowed_m = std::max(kMinDisagreement_m, kDisagreementSigmas * both_sigma_m) +
                           speed_of(fix) * std::abs(fix.time_s - vision_->time_s);
  if (apart_m <= allowed_m) {
    disagrees_since_s_.reset();
    if (!agrees_since_s_) agrees_since_s_ = fix.time_s;
  } else {
    agrees_since_s_.reset();
    if (!disagrees_since_s_) disagrees_since_s_ = fix.time_s;
  }
}

void GpsHealth::hear(const EkfReport& report) {
  if (report.knows_position) {
    ekf_knew_ = true;
    ekf_lost_since_s_.reset();
  } else if (ekf_knew_ && !ekf_lost_since_s_) {
    ekf_lost_since_s_ = report.time_s;
  }
  if (!report.gps_glitch) {
    glitch_since_s_.reset();
  } else if (!glitch_since_s_) {
    glitch_since_s_ = report.time_s;
  }
}

void GpsHealth::hear(const VisionPosition& vision) {
  if (sound(vision.place) && vision.sigma_m >= 0 && vision.sigma_m <= kMaxVisionSigma_m) vision_ = vision;
}

void GpsHealth::disturb() {
  good_since_s_.reset();
  agrees_since_s_.reset();
  disagrees_since_s_.reset();
}

bool GpsHealth::vision_speaks(double time_s) const {
  return vision_ && std::abs(time_s - vision_->time_s) <= kMaxVisionAge_s;
}

// While, and soon after, the autopilot's filter was told a fix of ours it says nothing about the receiver.
bool GpsHealth::filter_goes_by_it(double now_s) const { return !led_s_ || now_s - *led_s_ > kLed_s; }

std::optional<GpsJudged> GpsHealth::trouble(double now_s) const {
  using enum GpsVerdict;
  if (!lie_.empty()) return GpsJudged{spoofed, lie_};
  if (now_s - last_message_s_ > kGpsSilent_s) {
    return GpsJudged{denied, fmt::format("nothing from the receiver for {:.1f} s", now_s - last_message_s_)};
  }
  if (lasts(now_s, no_fix_since_s_, kGpsNoFix_s)) return GpsJudged{denied, "the receiver has no fix"};
  if (lasts(now_s, disagrees_since_s_, kDisagreement_s)) {
    const double apart_m = distance_m(vision_->place, last_fix_->place);
    return GpsJudged{spoofed, fmt::format("{:.0f} m from where pictures say", apart_m)};
  }
  // With GPS already out of use the filter is where our fix took it.
  if (judged_.verdict != GpsVerdict::trusted || !filter_goes_by_it(now_s)) return std::nullopt;
  if (lasts(now_s, glitch_since_s_, kEkfAlarm_s)) return GpsJudged{spoofed, "the autopilot reports a GPS glitch"};
  if (lasts(now_s, ekf_lost_since_s_, kEkfAlarm_s)) {
    return GpsJudged{denied, "the autopilot no longer knows its position by GPS"};
  }
  return std::nullopt;
}

bool GpsHealth::fit_again(double now_s) const {
  if (!good_since_s_) return false;
  if (judged_.verdict == GpsVerdict::unknown) return true;  // nothing speaks against the first one
  // The alarm would accuse it at once.
  if (filter_goes_by_it(now_s) && lasts(now_s, glitch_since_s_, kEkfAlarm_s)) return false;
  if (agrees_since_s_ && now_s - *good_since_s_ >= kGpsStable_s && now_s - *agrees_since_s_ >= kGpsStable_s)
    return true;
  const double alone_s = had_its_first_ ? kGpsStableAlone_s : kGpsFirst_s;
  return !lied_ && !vision_speaks(now_s) && now_s - *good_since_s_ >= alone_s;
}

GpsJudged GpsHealth::judge(double now_s, bool link_up) {
  if (!link_up) {
    last_message_s_ = std::max(last_message_s_, now_s);
    return judged_;
  }
  if (auto found = trouble(now_s)) {
    lie_.clear();
    disturb();
    const bool lies = found->verdict == GpsVerdict::spoofed;
    lied_ = lied_ || lies;
    // A receiver that lied and then falls silent stays a liar.
    if (lies || judged_.verdict == GpsVerdict::trusted || judged_.verdict == GpsVerdict::unknown) judged_ = *found;
  } else if (judged_.verdict != GpsVerdict::trusted && fit_again(now_s)) {
    judged_ = {GpsVerdict::trusted, lied_ ? "stable, and where pictures say" : "stable"};
    lied_ = false;
    had_its_first_ = true;
  }
  return judged_;
}

}  // namespace nadir
