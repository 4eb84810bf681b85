#include "commands/simulate/camera_pose/pose_assembler.hpp"

#include <cmath>

#include "geodesy/local_frame.hpp"

namespace nadir {
namespace {

constexpr std::int64_t kTruthHolds_us = 2'000'000;  // for so long the autopilot's belief is not asked for
constexpr double kMaxGap_s = 1;                     // between position and attitude

Eigen::Vector3d enu(const NedVelocity& v) { return {v.east_mps, v.north_mps, -v.down_mps}; }

}  // namespace

std::optional<LivePose> PoseAssembler::hear(const IncomingMessage& message, std::int64_t monotonic_us,
                                            std::int64_t unix_us) {
  if (const auto* time = std::get_if<SystemTime>(&message); time != nullptr && time->unix_us) {
    by_arrival_ = Tie{monotonic_us, *time->unix_us};
    by_boot_ = Tie{std::int64_t{time->boot_ms} * 1000, *time->unix_us};
  } else if (const auto* state = std::get_if<SimState>(&message)) {
    last_truth_us_ = monotonic_us;
    return pose_of(*state, monotonic_us, unix_us);
  } else if (const auto* position = std::get_if<GlobalPosition>(&message)) {
    position_ = *position;
  } else if (const auto* attitude = std::get_if<AircraftAttitude>(&message)) {
    return pose_of(*attitude, monotonic_us, unix_us);
  }
  return {};
}

LivePose PoseAssembler::pose_of(const SimState& state, std::int64_t monotonic_us, std::int64_t unix_us) const {
  LivePose pose;
  pose.unix_us = by_arrival_ ? by_arrival_->unix_us + (monotonic_us - by_arrival_->from_us) : unix_us;
  pose.place = state.place;
  pose.height_m = state.msl_m;
  pose.attitude = {state.yaw_rad, state.pitch_rad, state.roll_rad};
  pose.velocity_enu_mps = enu(state.velocity);
  return pose;
}

std::optional<LivePose> PoseAssembler::pose_of(const AircraftAttitude& attitude, std::int64_t monotonic_us,
                                               std::int64_t unix_us) const {
  if (last_truth_us_ && monotonic_us - *last_truth_us_ < kTruthHolds_us) return {};
  if (!position_) return {};
  const double gap_s = (static_cast<double>(attitude.boot_ms) - static_cast<double>(position_->boot_ms)) * 1e-3;
  if (!(std::abs(gap_s) <= kMaxGap_s)) return {};
  LivePose pose;
  pose.unix_us = by_boot_ ? by_boot_->unix_us + (std::int64_t{attitude.boot_ms} * 1000 - by_boot_->from_us) : unix_us;
  pose.velocity_enu_mps = enu(position_->velocity);
  const Eigen::Vector3d moved = pose.velocity_enu_mps * gap_s;
  pose.place = LocalFrame(position_->place).lonlat_from_enu(moved.x(), moved.y());
  pose.height_m = position_->msl_m + moved.z();
  pose.attitude = {attitude.yaw_rad, attitude.pitch_rad, attitude.roll_rad};
  return pose;
}

}  // namespace nadir
