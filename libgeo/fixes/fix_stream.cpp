#include "fixes/fix_stream.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "estimation/protection_level.hpp"

namespace nadir {
namespace {

constexpr double kMaxTime_s = 1e11;  // beyond: no time of a clock

}  // namespace

template <typename What>
void FixStream::list(std::int64_t now_us, const What& what) {
  if (entered_.inputs.size() < kMaxInputs) {
    entered_.inputs.push_back({now_us, what});
  } else {
    ++entered_.missing;
  }
}

void FixStream::on_input(std::int64_t now_us, const FixInputRecord::Attitude& attitude) {
  list(now_us, attitude);
  predictor_.on_message(now_us, AircraftAttitude{.roll_rad = static_cast<double>(attitude.roll_rad),
                                                 .pitch_rad = static_cast<double>(attitude.pitch_rad),
                                                 .yaw_rad = static_cast<double>(attitude.yaw_rad)});
}

void FixStream::on_input(std::int64_t now_us, const FixInputRecord::Acceleration& acceleration) {
  list(now_us, acceleration);
  predictor_.on_message(now_us, ImuSample{.acceleration_mps2 = {static_cast<double>(acceleration.forward_mps2),
                                                                static_cast<double>(acceleration.right_mps2),
                                                                static_cast<double>(acceleration.down_mps2)}});
}

bool FixStream::on_input(std::int64_t now_us, const FixInputRecord::ArrivedEstimate& which,
                         const VisionEstimate& estimate) {
  list(now_us, which);
  return predictor_.on_estimate(estimate, now_us);
}

std::optional<DueFix> FixStream::turn(std::int64_t now_us, std::int64_t unix_us, const FixStatus& status) {
  const std::optional<PredictedFix> predicted = predictor_.poll(now_us, unix_us);
  if (!predicted) return std::nullopt;
  DueFix due;
  FixInputRecord next;
  next.number = entered_.number + 1;
  due.inputs = std::exchange(entered_, std::move(next));
  due.inputs.time_us = now_us;
  due.inputs.unix_us = unix_us;
  due.inputs.status = status;
  // The record has 32 bits for how long ago: only a clock that jumps makes them too few.
  const auto untimed = [&](const FixInputRecord::Input& input) {
    return input.time_us > now_us || now_us - input.time_us > std::numeric_limits<std::uint32_t>::max();
  };
  due.inputs.missing += static_cast<std::uint32_t>(std::erase_if(due.inputs.inputs, untimed));

  if (status.permitted && predicted->fix) {
    due.fix = predicted->fix;
    due.fix->sigma_m = std::max(due.fix->sigma_m, status.sigma_m);  // never shrinks while blind
  }
  if (status.served && status.permitted) due.jumped_m = predicted->jumped_m;
  due.message = due.fix ? gps_input(*due.fix, gps_id_) : gps_input_without_fix(unix_us, gps_id_);
  if (due.message.fix >= GpsFix::two_d) due.source = status.source;
  return due;
}

std::optional<VisionEstimate> vision_estimate(const Estimate& estimate, const StateEstimate& state, double captured_s,
                                              std::optional<double> ground_msl_m, double integrity_risk) {
  if (!estimate.position || !(std::abs(captured_s) < kMaxTime_s)) return std::nullopt;
  VisionEstimate vision;
  vision.time_us = std::llround(captured_s * 1e6);
  vision.place = *estimate.position;
  vision.sigma_m = bounding_sigma_m(estimate.sigma_m, estimate.hpl_m, integrity_risk);
  vision.east_mps = state.velocity_mps.x();
  vision.north_mps = state.velocity_mps.y();
  vision.speed_sigma_mps = state.velocity_sigma_mps;
  if (ground_msl_m) vision.msl_m = *ground_msl_m + state.agl_m;
  if (ground_msl_m) vision.vertical_sigma_m = state.agl_sigma_m;
  vision.visual = estimate.source == SourceLabel::satellite_anchored || estimate.source == SourceLabel::vo_extrapolated;
  return vision;
}

FixRecord fix_record(const DueFix& sent) {
  const GpsInput& message = sent.message;
  FixRecord record;
  record.time_s = static_cast<double>(sent.inputs.time_us) * 1e-6;
  record.unix_us = message.unix_us;
  record.fix_type = static_cast<int>(message.fix);
  record.accuracy_m = message.horizontal_accuracy_m;
  if (message.fix < GpsFix::two_d) return record;
  record.source = sent.source;
  record.place = message.place;
  record.msl_m = message.msl_m;
  record.vertical_accuracy_m = message.vertical_accuracy_m;
  record.speed_accuracy_mps = message.speed_accuracy_mps;
  if (message.velocity) {
    record.north_mps = message.velocity->north_mps;
    record.east_mps = message.velocity->east_mps;
    record.down_mps = message.velocity->down_mps;
  }
  return record;
}

}  // namespace nadir
