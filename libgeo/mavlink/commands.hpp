// Commands to the autopilot and from operators. Their numbers come from the generated headers.
#pragma once

#include <cstdint>
#include <string>
#include <variant>

#include "mavlink/messages.hpp"

namespace nadir {

// Messages that can be requested from the autopilot.
enum class StreamedMessage {
  system_time,
  attitude,
  gimbal_attitude,
  global_position,
  gps_raw,
  gps2_raw,
  raw_imu,
  terrain_report,
  distance_sensor,
  ekf_status,
  highres_imu,
  estimator_status,
  local_origin,
  autopilot_version,
  camera_information,
  video_streams,
  sim_state,
};

std::uint32_t message_id(StreamedMessage message);

// Requests a message at a rate.
CommandLong set_message_interval(MavlinkAddress target, StreamedMessage message, double rate_hz);

// Requests a message once. Of video streams: of all of them.
CommandLong request_message(MavlinkAddress target, StreamedMessage message);

// Reboots the autopilot: only on the ground.
CommandLong restart_command(MavlinkAddress target);

// MAV_CMD_EXTERNAL_POSITION_ESTIMATE, for an autopilot that flies by dead reckoning: the second output mode, one
// command per anchor.
struct ExternalPosition {
  LonLat place{};
  double sigma_m = 0;
  double sent_s = 0;        // our clock
  double processing_s = 0;  // from capture to now
};
CommandInt external_position_estimate(MavlinkAddress target, const ExternalPosition& position);

// An operator's approximate position: the same command, sent to us.
struct PositionHint {
  LonLat place{};
  double radius_m = 0;  // above 0
  double age_s = 0;     // when it was sent
};
bool is_position_hint(const CommandInt& command);
// The hint, or why it is none: "no valid place".
std::variant<PositionHint, std::string> position_hint(const CommandInt& command);

// The same command with its place in numbers of single precision (half a metre), and without a frame.
CommandInt as_command_int(const CommandLong& command);

// MAVLink's rule: our system, and our component or 0, all components of the system.
bool is_addressed_to(const CommandInt& command, MavlinkAddress station);

}  // namespace nadir
