// The commands that we send to the autopilot and take from operators. Their numbers come from the generated headers.
#pragma once

#include <cstdint>
#include <optional>

#include "mavlink/messages.hpp"

namespace nadir {

// Messages that can be asked for by kind.
enum class StreamedMessage {
  heartbeat,
  system_time,
  attitude,
  global_position,
  gps_raw,
  gps2_raw,
  raw_imu,
  scaled_pressure,
  flight_figures,
  wind,
  terrain_report,
  distance_sensor,
  ekf_status,
  system_status,
  autopilot_version,
  sim_state,
};

std::uint32_t message_id(StreamedMessage message);

// "Send this one every so often."
CommandLong set_message_interval(MavlinkAddress target, StreamedMessage message, double rate_hz);

// "Send this one once."
CommandLong request_message(MavlinkAddress target, StreamedMessage message);

// "Start anew": only for an aircraft on the ground.
CommandLong restart_command(MavlinkAddress target);

// A position for an autopilot that flies by dead reckoning: the second output mode, one command per anchor.
struct PositionForDeadReckoning {
  LonLat place{};
  double sigma_m = 0;
  double sent_s = 0;        // our clock
  double processing_s = 0;  // from the picture to now
};
CommandInt external_position_estimate(MavlinkAddress target, const PositionForDeadReckoning& position);

// The operator's "you are about here": the same command, sent to us. nullopt: another command, or no usable position.
struct PositionHint {
  LonLat place{};
  double radius_m = 0;
};
std::optional<PositionHint> position_hint(const CommandInt& command);

}  // namespace nadir
