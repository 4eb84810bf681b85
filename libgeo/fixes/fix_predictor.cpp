#include "fixes/fix_predictor.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "geodesy/hypotenuse.hpp"
#include "geodesy/local_frame.hpp"

namespace nadir {
namespace {

double seconds(std::int64_t us) { return static_cast<double>(us) * 1e-6; }

bool valid(const VisionEstimate& e) {
  return std::abs(e.place.lat_deg) <= 90 && std::abs(e.place.lon_deg) <= 180 && e.sigma_m >= 0 &&
         std::isfinite(e.sigma_m) && std::isfinite(e.north_mps) && std::isfinite(e.east_mps) &&
         e.speed_sigma_mps >= 0 && std::isfinite(e.speed_sigma_mps);
}

}  // namespace

bool FixPredictor::lost(std::int64_t now_us) const {
  return !last_visual_us_ || now_us - *last_visual_us_ > options_.blackout_us || sigma_m(now_us) > kMaxFixSigma_m;
}

double FixPredictor::sigma_m(std::int64_t now_us) const {
  const double dt_s = seconds(now_us - last_->time_us);
  const double acceleration_m = 0.5 * options_.acceleration_sigma_mps2 * dt_s * dt_s;
  const InertialMotion::Gain gained = gain(now_us);
  const double unobserved_m = unobserved_mps(gained) * (dt_s - gained.unknown_s / 2);
  return hypotenuse(hypotenuse(last_->sigma_m, unobserved_m), last_->speed_sigma_mps * dt_s, acceleration_m);
}

InertialMotion::Gain FixPredictor::gain(std::int64_t now_us) const { return motion_.gain(from_, seconds(now_us)); }

// One sigma of the unobserved velocity change, at most a reversal of direction.
double FixPredictor::unobserved_mps(const InertialMotion::Gain& gain) const {
  return std::min(options_.unobserved_sigma_mps2 * gain.unknown_s, 2 * hypotenuse(last_->east_mps, last_->north_mps));
}

FixPredictor::Offset FixPredictor::ramp_at(std::int64_t now_us) const {
  const double size_m = hypotenuse(offset_.east_m, offset_.north_m);
  const double left_m = size_m - options_.ramp_mps * seconds(now_us - offset_us_);
  if (left_m <= 0) return {};
  return {offset_.east_m * left_m / size_m, offset_.north_m * left_m / size_m};
}

LonLat FixPredictor::place_at(std::int64_t now_us, const Offset& offset) const {
  const double dt_s = seconds(now_us - last_->time_us);
  const InertialMotion::Plane displacement_m = gain(now_us).displacement_m;
  return LocalFrame(last_->place)
      .lonlat_from_plane({last_->east_mps * dt_s + displacement_m.east + offset.east_m,
                          last_->north_mps * dt_s + displacement_m.north + offset.north_m});
}

bool FixPredictor::on_estimate(const VisionEstimate& estimate, std::int64_t now_us) {
  if (!valid(estimate) || estimate.time_us > now_us || (last_ && estimate.time_us < last_->time_us)) return false;
  // Dead reckoning with a larger σ than the inertial propagation of the last visual estimate adds nothing.
  if (!estimate.visual && last_ && !lost(now_us) && estimate.sigma_m > sigma_m(estimate.time_us)) return true;
  std::optional<LonLat> last_fix;
  if (had_fix_ && !lost(now_us)) last_fix = place_at(now_us, ramp_at(now_us));
  last_ = estimate;
  from_ = motion_.moment(seconds(estimate.time_us));
  fresh_ = true;
  if (estimate.visual) last_visual_us_ = estimate.time_us;
  offset_ = {};
  offset_us_ = now_us;
  if (!last_fix) return true;

  // In a frame around the new position: the offset of the last fix from it.
  const PlanePoint difference = LocalFrame(place_at(now_us, {})).plane_from_lonlat(*last_fix);
  const double size_m = hypotenuse(difference.east_m, difference.north_m);
  if (size_m > options_.jump_beyond_m) {
    jumped_m_ = std::max(size_m, jumped_m_.value_or(0));
  } else {
    offset_ = {difference.east_m, difference.north_m};
  }
  return true;
}

std::int64_t FixPredictor::next_due_us() const {
  if (!fresh_ || !last_sent_us_) return grid_due_us_;
  return std::min(grid_due_us_, *last_sent_us_ + options_.min_gap_us);
}

std::optional<PredictedFix> FixPredictor::poll(std::int64_t now_us, std::int64_t unix_us) {
  if (now_us < next_due_us()) return std::nullopt;
  // The grid continues while we keep up with it; after a stall, or an early fix for a new estimate, it restarts, so
  // that fixes never come in bursts.
  const std::int64_t late_us = now_us - grid_due_us_;
  const bool on_grid = grid_due_us_ != 0 && late_us >= 0 && late_us < options_.period_us;
  grid_due_us_ = (on_grid ? grid_due_us_ : now_us) + options_.period_us;
  last_sent_us_ = now_us;
  fresh_ = false;

  PredictedFix result;
  result.jumped_m = std::exchange(jumped_m_, std::nullopt);
  const bool fixed = !lost(now_us);
  had_fix_ = fixed;
  if (!fixed) return result;

  const Offset ramp = ramp_at(now_us);
  result.ramp_left_m = hypotenuse(ramp.east_m, ramp.north_m);
  const double dt_s = seconds(now_us - last_->time_us);
  const InertialMotion::Gain gained = gain(now_us);
  Fix fix{.unix_us = unix_us,
          .place = place_at(now_us, ramp),
          .sigma_m = hypotenuse(sigma_m(now_us), result.ramp_left_m),
          .msl_m = last_->msl_m,
          .vertical_sigma_m = last_->vertical_sigma_m,
          .velocity = GpsVelocity{last_->north_mps + gained.velocity_mps.north,
                                  last_->east_mps + gained.velocity_mps.east, last_->down_mps},
          .speed_sigma_mps =
              hypotenuse(last_->speed_sigma_mps, options_.acceleration_sigma_mps2 * dt_s, unobserved_mps(gained)),
          .yaw_rad = last_->yaw_rad};
  if (fix.msl_m && last_->down_mps) *fix.msl_m -= *last_->down_mps * dt_s;
  result.fix = fix;
  return result;
}

}  // namespace nadir
