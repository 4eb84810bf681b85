#include "commands/simulate/camera_pose/mavlink_pose_source.hpp"

#include <poll.h>

#include <algorithm>
#include <string>
#include <utility>

#include "base/error.hpp"
#include "mavlink/commands.hpp"

namespace nadir {
namespace {

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

MavlinkPoseSource::MavlinkPoseSource(std::string_view endpoint)
    : link_(make_transport(parse_endpoint(endpoint)), kOwn, std::nullopt) {
  take_what_came();
  const bool waits = parse_endpoint(endpoint).kind == Endpoint::Kind::udp_listen;
  if (waits && !link_.transport().is_open()) {
    throw Error({.what = "the poses cannot be listened for",
                 .where = std::string(endpoint),
                 .expected = "an address of this machine with a free port",
                 .found = link_.transport().last_error(),
                 .fix = "choose another port, or end the program that uses it"});
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
    if (auto pose = assembler_.hear(received.message, received.monotonic_us, utc_us())) {
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
