#include "mavlink/commands.hpp"

#include <ardupilotmega/mavlink.h>

#include <cmath>
#include <limits>

namespace nadir {
namespace {

constexpr float kNotUsed = std::numeric_limits<float>::quiet_NaN();

// The sender's time wraps, so that a float resolves it to about 20 µs.
constexpr double kTimeWrap_s = 250.0;

bool is_global(std::uint8_t frame) {
  switch (frame) {
    case MAV_FRAME_GLOBAL:
    case MAV_FRAME_GLOBAL_RELATIVE_ALT:
    case MAV_FRAME_GLOBAL_INT:
    case MAV_FRAME_GLOBAL_RELATIVE_ALT_INT:
    case MAV_FRAME_GLOBAL_TERRAIN_ALT:
    case MAV_FRAME_GLOBAL_TERRAIN_ALT_INT: return true;
    default: return false;
  }
}

}  // namespace

std::uint32_t message_id(StreamedMessage message) {
  switch (message) {
    case StreamedMessage::system_time: return MAVLINK_MSG_ID_SYSTEM_TIME;
    case StreamedMessage::attitude: return MAVLINK_MSG_ID_ATTITUDE;
    case StreamedMessage::gimbal_attitude: return MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS;
    case StreamedMessage::global_position: return MAVLINK_MSG_ID_GLOBAL_POSITION_INT;
    case StreamedMessage::gps_raw: return MAVLINK_MSG_ID_GPS_RAW_INT;
    case StreamedMessage::gps2_raw: return MAVLINK_MSG_ID_GPS2_RAW;
    case StreamedMessage::raw_imu: return MAVLINK_MSG_ID_RAW_IMU;
    case StreamedMessage::terrain_report: return MAVLINK_MSG_ID_TERRAIN_REPORT;
    case StreamedMessage::distance_sensor: return MAVLINK_MSG_ID_DISTANCE_SENSOR;
    case StreamedMessage::ekf_status: return MAVLINK_MSG_ID_EKF_STATUS_REPORT;
    case StreamedMessage::highres_imu: return MAVLINK_MSG_ID_HIGHRES_IMU;
    case StreamedMessage::estimator_status: return MAVLINK_MSG_ID_ESTIMATOR_STATUS;
    case StreamedMessage::local_origin: return MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN;
    case StreamedMessage::autopilot_version: return MAVLINK_MSG_ID_AUTOPILOT_VERSION;
    case StreamedMessage::camera_information: return MAVLINK_MSG_ID_CAMERA_INFORMATION;
    case StreamedMessage::video_streams: return MAVLINK_MSG_ID_VIDEO_STREAM_INFORMATION;
    case StreamedMessage::sim_state: return MAVLINK_MSG_ID_SIM_STATE;
  }
  return 0;
}

CommandLong set_message_interval(MavlinkAddress target, StreamedMessage message, double rate_hz) {
  return {.target = target,
          .command = MAV_CMD_SET_MESSAGE_INTERVAL,
          .confirmation = 0,
          .parameters = {static_cast<float>(message_id(message)), static_cast<float>(1e6 / rate_hz)}};
}

CommandLong request_message(MavlinkAddress target, StreamedMessage message) {
  return {.target = target,
          .command = MAV_CMD_REQUEST_MESSAGE,
          .confirmation = 0,
          .parameters = {static_cast<float>(message_id(message))}};
}

CommandLong restart_command(MavlinkAddress target) {
  return {.target = target, .command = MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, .confirmation = 0, .parameters = {1.0F}};
}

CommandInt external_position_estimate(MavlinkAddress target, const ExternalPosition& position) {
  return {.target = target,
          .command = MAV_CMD_EXTERNAL_POSITION_ESTIMATE,
          .frame = MAV_FRAME_GLOBAL,
          .parameters = {static_cast<float>(std::fmod(position.sent_s, kTimeWrap_s)),
                         static_cast<float>(position.processing_s), static_cast<float>(position.sigma_m), 0.0F},
          .place = position.place,
          .z = kNotUsed};
}

bool is_position_hint(const CommandInt& command) { return command.command == MAV_CMD_EXTERNAL_POSITION_ESTIMATE; }

// The time of sending (parameter 1) is one of the sender's clock, and wraps: it says nothing to others.
std::variant<PositionHint, std::string> position_hint(const CommandInt& command) {
  const double age_s = static_cast<double>(command.parameters[1]);
  const double radius_m = static_cast<double>(command.parameters[2]);
  const LonLat place = command.place;
  if (!is_global(command.frame)) return "its frame is not global";
  // False for NaN, which a place of COMMAND_LONG may be.
  if (!(std::abs(place.lat_deg) <= 90 && std::abs(place.lon_deg) <= 180)) return "no valid place";
  if (!(radius_m > 0) || !std::isfinite(radius_m)) return "no accuracy";
  if (!(age_s >= 0)) return "no valid age";
  return PositionHint{place, radius_m, age_s};
}

CommandInt as_command_int(const CommandLong& command) {
  const auto& p = command.parameters;
  return {.target = command.target,
          .command = command.command,
          .frame = MAV_FRAME_GLOBAL,
          .parameters = {p[0], p[1], p[2], p[3]},
          .place = {static_cast<double>(p[5]), static_cast<double>(p[4])},
          .z = p[6]};
}

bool is_addressed_to(const CommandInt& command, MavlinkAddress station) {
  return command.target.system == station.system &&
         (command.target.component == station.component || command.target.component == 0);
}

}  // namespace nadir
