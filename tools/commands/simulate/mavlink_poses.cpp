#include "commands/simulate/mavlink_poses.hpp"

#include <poll.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "base/error.hpp"
#include "geodesy/local_frame.hpp"
#include "mavlink/commands.hpp"

namespace nadir {
namespace {

constexpr std::int64_t kTruthHolds_us =
    2'000'000;                   // after SIM_STATE, for so long the autopilot's own estimate is ignored
constexpr double kMaxGap_s = 1;  // between position and attitude

Eigen::Vector3d enu(const NedVelocity& v) { return {v.east_mps, v.north_mps, -v.down_mps}; }

constexpr MavlinkAddress kOwn{.system = 1, .component = 100};  // MAV_COMP_ID_CAMERA
constexpr std::int64_t kSecond_us = 1'000'000;
constexpr double kPoseRate_hz = 25;
constexpr double kTimeRate_hz = 5;

std::int64_t steady_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

std::int64_t utc_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

}  // namespace

std::optional<LivePose> PoseAssembler::on_message(const IncomingMessage& message, std::int64_t monotonic_us,
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
  pose.rate_rad_s = {state.rate_rad_s.x, state.rate_rad_s.y, state.rate_rad_s.z};
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
  pose.place = LocalFrame(position_->place).lonlat_from_plane({moved.x(), moved.y()});
  pose.height_m = position_->msl_m + moved.z();
  pose.attitude = {attitude.yaw_rad, attitude.pitch_rad, attitude.roll_rad};
  pose.rate_rad_s = {attitude.rate_rad_s.x, attitude.rate_rad_s.y, attitude.rate_rad_s.z};
  return pose;
}

MavlinkPoseSource::MavlinkPoseSource(std::string_view endpoint)
    : link_(make_transport(parse_endpoint(endpoint)), kOwn, std::nullopt) {
  take_what_came();
  const bool waits = parse_endpoint(endpoint).kind == Endpoint::Kind::udp_listen;
  if (waits && !link_.transport().is_open()) {
    throw Error({.what = "cannot listen for poses",
                 .where = std::string(endpoint),
                 .expected = "an address of this machine with a free port",
                 .found = link_.transport().last_error(),
                 .fix = "choose another port, or stop the program that uses it"});
  }
}

std::optional<LivePose> MavlinkPoseSource::latest(std::chrono::milliseconds timeout) {
  const std::int64_t until_us = steady_us() + timeout.count() * 1000;
  for (;;) {
    take_what_came();
    if (newest_) return std::exchange(newest_, std::nullopt);
    const std::int64_t left_us = until_us - steady_us();
    if (left_us <= 0) return {};
    pollfd waiting{.fd = link_.transport().descriptor(), .events = link_.transport().events(), .revents = 0};
    // Without a descriptor (-1, which poll() overlooks) the link is tried again within a second.
    ::poll(&waiting, 1, static_cast<int>(std::min<std::int64_t>(left_us / 1000 + 1, 100)));
  }
}

void MavlinkPoseSource::take_what_came() {
  const std::int64_t now_us = steady_us();
  link_.advance(now_us, [&](const ReceivedMessage& received) {
    const auto* heartbeat = std::get_if<Heartbeat>(&received.message);
    if (heartbeat != nullptr && heartbeat->is_autopilot) autopilot_ = received.source;
    if (auto pose = assembler_.on_message(received.message, received.monotonic_us, utc_us())) {
      newest_ = pose;
      last_pose_us_ = now_us;
    }
  });
  keep_in_touch(now_us);
}

void MavlinkPoseSource::keep_in_touch(std::int64_t now_us) {
  if (now_us < next_heartbeat_us_) return;
  next_heartbeat_us_ = now_us + kSecond_us;
  link_.send(OwnHeartbeat{.state = SystemState::active}, now_us);
  if (!autopilot_ || now_us - last_pose_us_ < kSecond_us) return;
  for (const StreamedMessage message :
       {StreamedMessage::sim_state, StreamedMessage::global_position, StreamedMessage::attitude}) {
    link_.send(set_message_interval(*autopilot_, message, kPoseRate_hz), now_us);
  }
  link_.send(set_message_interval(*autopilot_, StreamedMessage::system_time, kTimeRate_hz), now_us);
}

}  // namespace nadir
