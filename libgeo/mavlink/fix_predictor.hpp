// Fixes at a steady rate from estimates that come when pictures do.
//
// Between estimates the last one is carried by its velocity and by what the accelerometers say since, and σ grows with
// the velocity's own σ and with what an aircraft may do meanwhile: little where they were heard, a turn where they were
// not. A new estimate that disagrees with what was said last is not jumped to: the difference shrinks at a rate that
// the autopilot's filter follows, and until it is gone σ covers it. Differences too large for that are jumped once, and
// told.
//
// Everything here comes from our own estimates. The autopilot's fused position has no way in: it would come back as its
// own witness. Time is a steady clock's, in microseconds.
#pragma once

#include <cstdint>
#include <optional>

#include "mavlink/gps_input.hpp"
#include "mavlink/inertial_motion.hpp"

namespace nadir {

// One of ours, at the moment of its picture.
struct VisionEstimate {
  std::int64_t time_us = 0;
  LonLat place{};
  double sigma_m = 0;
  double north_m_s = 0;
  double east_m_s = 0;
  double speed_sigma_m_s = 0;
  std::optional<double> down_m_s{};
  std::optional<double> msl_m{};
  std::optional<double> vertical_sigma_m{};
  std::optional<double> yaw_rad{};
  bool seen = true;  // by the camera; false: dead reckoning, which does not end a blackout
};

struct PredictorOptions {
  std::int64_t period_us = 100'000;
  std::int64_t least_gap_us = 40'000;  // a new estimate goes out at once, but not sooner after the last fix
  double ramp_m_s = 5.0;
  double jump_beyond_m = 50.0;
  double acceleration_sigma_m_s2 = 0.5;  // of accelerometers turned level by attitudes that are some degrees off
  double unheard_sigma_m_s2 = 2.5;       // where none were heard: a turn
  std::int64_t blackout_us = 30'000'000;
};

struct PredictedFix {
  std::optional<Fix> fix{};  // none: say "no fix"
  double ramp_left_m = 0;
  std::optional<double> jumped_m{};  // since the last one: tell the operator
};

class FixPredictor {
 public:
  explicit FixPredictor(const PredictorOptions& options = {}) : options_(options) {}

  // Attitude and accelerometers of the aircraft, as they come.
  template <typename Message>
  void hear(std::int64_t now_us, const Message& message) {
    motion_.hear(static_cast<double>(now_us) * 1e-6, message);
  }

  // Dead reckoning that is less sure than the fix already is, is taken and changes nothing. False, and nothing changes:
  // it is older than what is known, from the future, or its numbers are none. One of the same moment is that moment
  // thought over, with what the map said since.
  bool observe(const VisionEstimate& estimate, std::int64_t now_us);

  // A fix when one is due: every period_us at least, and soon after a new estimate. unix_us is now in UTC, for the
  // message.
  std::optional<PredictedFix> poll(std::int64_t now_us, std::int64_t unix_us);

  // When the next is due; 0 before the first.
  std::int64_t next_due_us() const;

 private:
  struct Offset {
    double east_m = 0;
    double north_m = 0;
  };

  bool lost(std::int64_t now_us) const;
  InertialMotion::Gain gain(std::int64_t now_us) const;  // since the last estimate's picture
  double unheard_m_s(const InertialMotion::Gain& gain) const;
  double sigma_m(std::int64_t now_us) const;  // without the ramp's share
  Offset ramp_at(std::int64_t now_us) const;
  LonLat place_at(std::int64_t now_us, const Offset& offset) const;

  PredictorOptions options_;
  InertialMotion motion_;
  InertialMotion::Moment from_;  // of last_
  std::optional<VisionEstimate> last_;
  std::optional<std::int64_t> last_seen_us_;
  Offset offset_;  // what was said less what is estimated, at offset_us_
  std::int64_t offset_us_ = 0;
  bool said_a_fix_ = false;  // the last message held one
  std::optional<double> jumped_m_;
  std::int64_t grid_due_us_ = 0;
  std::optional<std::int64_t> last_sent_us_;
  bool fresh_ = false;  // an estimate has come since
};

}  // namespace nadir
