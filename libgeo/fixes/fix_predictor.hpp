// Fixes at a constant rate from estimates at the frame rate.
//
// The last estimate (p₀, v₀ at t₀, τ = t − t₀) is propagated with its velocity and the accelerometers
// (inertial_motion.hpp: displacement d and velocity gain Δv since t₀; u seconds without samples):
//   p(t) = p₀ + v₀ τ + d + r(t)          v(t) = v₀ + Δv
//   σ(t)² = σ₀² + (σ_v τ)² + (σ_a τ²/2)² + (s (τ − u/2))² + |r(t)|²,   s = min(σ_u u, 2 |v₀|)
// σ_a covers the attitude error of levelled accelerometers, σ_u an unobserved turn.
//
// A new estimate that disagrees with the last fix is not jumped to: the difference r shrinks at a rate that the
// autopilot's filter can follow, and σ covers it meanwhile. Larger differences are jumped once, and reported.
//
// Only our own estimates enter. The autopilot's fused position must not: it contains our fixes. Times are those of a
// steady clock, in microseconds.
#pragma once

#include <cstdint>
#include <optional>

#include "fixes/inertial_motion.hpp"
#include "mavlink/gps_input.hpp"

namespace nadir {

// An estimate of the localizer, valid at the capture time of its frame.
struct VisionEstimate {
  std::int64_t time_us = 0;
  LonLat place{};
  double sigma_m = 0;
  double north_mps = 0;
  double east_mps = 0;
  double speed_sigma_mps = 0;
  std::optional<double> down_mps{};
  std::optional<double> msl_m{};
  std::optional<double> vertical_sigma_m{};
  std::optional<double> yaw_rad{};
  bool visual = true;  // false: dead reckoning, which does not end a blackout
};

struct PredictorOptions {
  std::int64_t period_us = 100'000;
  std::int64_t min_gap_us = 40'000;  // between the last fix and the first one of a new estimate
  double ramp_mps = 5.0;
  double jump_beyond_m = 50.0;
  double acceleration_sigma_mps2 = 0.5;  // levelled by an attitude that is some degrees off
  double unobserved_sigma_mps2 = 2.5;    // without samples: a turn
  std::int64_t blackout_us = 30'000'000;
};

struct PredictedFix {
  std::optional<Fix> fix{};  // nullopt: send "no fix"
  double ramp_left_m = 0;
  std::optional<double> jumped_m{};  // distance from the last fix: notify the operator
};

class FixPredictor {
 public:
  explicit FixPredictor(const PredictorOptions& options = {}) : options_(options) {}

  // AircraftAttitude and ImuSample, as they arrive.
  template <typename Message>
  void on_message(std::int64_t now_us, const Message& message) {
    motion_.on_message(static_cast<double>(now_us) * 1e-6, message);
  }

  // False, and nothing changes: older than the last estimate, in the future, or not finite. An estimate of the same
  // time as the last one replaces it: that frame after a map match. Dead reckoning with a larger σ than the current fix
  // is accepted and changes nothing.
  bool on_estimate(const VisionEstimate& estimate, std::int64_t now_us);

  // The next fix when it is due: every period_us, and soon after a new estimate. unix_us: the current UTC.
  std::optional<PredictedFix> poll(std::int64_t now_us, std::int64_t unix_us);

  // When the next fix is due; 0 before the first.
  std::int64_t next_due_us() const;

 private:
  struct Offset {
    double east_m = 0;
    double north_m = 0;
  };

  bool lost(std::int64_t now_us) const;
  InertialMotion::Gain gain(std::int64_t now_us) const;  // since the capture time of last_
  double unobserved_mps(const InertialMotion::Gain& gain) const;
  double sigma_m(std::int64_t now_us) const;  // without the ramp
  Offset ramp_at(std::int64_t now_us) const;
  LonLat place_at(std::int64_t now_us, const Offset& offset) const;

  PredictorOptions options_;
  InertialMotion motion_;
  InertialMotion::Moment from_;  // of last_
  std::optional<VisionEstimate> last_;
  std::optional<std::int64_t> last_visual_us_;
  Offset offset_;  // last fix minus estimate, at offset_us_
  std::int64_t offset_us_ = 0;
  bool had_fix_ = false;  // in the last poll()
  std::optional<double> jumped_m_;
  std::int64_t grid_due_us_ = 0;
  std::optional<std::int64_t> last_sent_us_;
  bool fresh_ = false;  // a new estimate since
};

}  // namespace nadir
