#include <ardupilotmega/mavlink.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "geodesy/angles.hpp"
#include "mavlink/codec.hpp"

namespace nadir {
namespace {

using Decoded = std::optional<IncomingMessage>;

constexpr double kStandardGravity = 9.80665;

static_assert(static_cast<int>(GpsFix::rtk_fixed) == GPS_FIX_TYPE_RTK_FIXED);
static_assert(static_cast<int>(TextSeverity::debug) == MAV_SEVERITY_DEBUG);
static_assert(static_cast<int>(SystemState::emergency) == MAV_STATE_EMERGENCY);
static_assert(static_cast<int>(CommandResult::in_progress) == MAV_RESULT_IN_PROGRESS);

template <class... Numbers>
bool finite(Numbers... numbers) {
  return (std::isfinite(numbers) && ...);
}

bool finite(const Vector3& v) { return finite(v.x, v.y, v.z); }

// Numbers above the last that we know are taken for the last.
template <class Enum>
Enum limited(std::uint8_t value, Enum last) {
  return static_cast<Enum>(std::min(value, static_cast<std::uint8_t>(last)));
}

LonLat place_e7(std::int32_t lat, std::int32_t lon) { return {lon * 1e-7, lat * 1e-7}; }

std::optional<double> scaled_unless(std::uint32_t value, std::uint32_t unknown, double scale) {
  if (value == unknown) return std::nullopt;
  return value * scale;
}

std::optional<double> heading_cdeg(std::uint16_t value) {
  if (value == UINT16_MAX) return std::nullopt;
  return radians(value * 0.01);
}

template <std::size_t size>
std::string text_of(const char (&field)[size]) {
  return {field, strnlen(field, size)};
}

Decoded from_wire(const mavlink_heartbeat_t& w) {
  return Heartbeat{.vehicle_type = w.type,
                   .is_autopilot = w.autopilot != MAV_AUTOPILOT_INVALID,
                   .is_ardupilot = w.autopilot == MAV_AUTOPILOT_ARDUPILOTMEGA,
                   .armed = (w.base_mode & MAV_MODE_FLAG_SAFETY_ARMED) != 0,
                   .custom_mode = w.custom_mode,
                   .state = limited(w.system_status, SystemState::emergency)};
}

Decoded from_wire(const mavlink_system_time_t& w) {
  SystemTime time{.unix_us = std::nullopt, .boot_ms = w.time_boot_ms};
  // Before it has heard of the date the autopilot sends zero, or the time since it was switched on.
  constexpr std::uint64_t kYear2015 = 1420070400000000;
  if (w.time_unix_usec >= kYear2015 && w.time_unix_usec < UINT64_MAX / 4) {
    time.unix_us = static_cast<std::int64_t>(w.time_unix_usec);
  }
  return time;
}

Decoded from_wire(const mavlink_timesync_t& w) { return Timesync{.answered_ns = w.tc1, .sent_ns = w.ts1}; }

Decoded from_wire(const mavlink_attitude_t& w) {
  const Vector3 rate{w.rollspeed, w.pitchspeed, w.yawspeed};
  if (!finite(w.roll, w.pitch, w.yaw) || !finite(rate)) return std::nullopt;
  return AircraftAttitude{w.time_boot_ms, w.roll, w.pitch, w.yaw, rate};
}

Decoded from_wire(const mavlink_global_position_int_t& w) {
  return GlobalPosition{.boot_ms = w.time_boot_ms,
                        .place = place_e7(w.lat, w.lon),
                        .msl_m = w.alt * 1e-3,
                        .above_home_m = w.relative_alt * 1e-3,
                        .velocity = {w.vx * 0.01, w.vy * 0.01, w.vz * 0.01},
                        .heading_rad = heading_cdeg(w.hdg)};
}

// GPS_RAW_INT and GPS2_RAW have the same fields, but for those of differential corrections.
template <class Wire>
GpsRaw gps_raw(const Wire& w, int receiver) {
  GpsRaw raw{.receiver = receiver,
             .time_us = w.time_usec,
             .fix = limited(w.fix_type, GpsFix::rtk_fixed),
             .place = place_e7(w.lat, w.lon),
             .msl_m = w.alt * 1e-3,
             .hdop = scaled_unless(w.eph, UINT16_MAX, 0.01),
             .vdop = scaled_unless(w.epv, UINT16_MAX, 0.01),
             .ground_speed_m_s = scaled_unless(w.vel, UINT16_MAX, 0.01),
             .course_rad = heading_cdeg(w.cog),
             .satellites = std::nullopt,
             .horizontal_accuracy_m = scaled_unless(w.h_acc, 0, 1e-3),
             .vertical_accuracy_m = scaled_unless(w.v_acc, 0, 1e-3),
             .speed_accuracy_m_s = scaled_unless(w.vel_acc, 0, 1e-3),
             .yaw_rad = std::nullopt};
  if (w.satellites_visible != UINT8_MAX) raw.satellites = w.satellites_visible;
  if (w.yaw != 0) raw.yaw_rad = heading_cdeg(w.yaw);  // 0: none, 36000: north
  return raw;
}

Decoded from_wire(const mavlink_gps_raw_int_t& w) { return gps_raw(w, 1); }
Decoded from_wire(const mavlink_gps2_raw_t& w) { return gps_raw(w, 2); }

template <class Wire>
ImuSample imu_sample(const Wire& w, int instance, std::uint64_t time_us) {
  constexpr double kAcceleration = kStandardGravity * 1e-3;
  return {.instance = instance,
          .time_us = time_us,
          .acceleration_m_s2 = {w.xacc * kAcceleration, w.yacc * kAcceleration, w.zacc * kAcceleration},
          .rate_rad_s = {w.xgyro * 1e-3, w.ygyro * 1e-3, w.zgyro * 1e-3}};
}

Decoded from_wire(const mavlink_raw_imu_t& w) { return imu_sample(w, w.id + 1, w.time_usec); }
Decoded from_wire(const mavlink_scaled_imu_t& w) { return imu_sample(w, 1, w.time_boot_ms * 1000ULL); }
Decoded from_wire(const mavlink_scaled_imu2_t& w) { return imu_sample(w, 2, w.time_boot_ms * 1000ULL); }
Decoded from_wire(const mavlink_scaled_imu3_t& w) { return imu_sample(w, 3, w.time_boot_ms * 1000ULL); }

Decoded from_wire(const mavlink_scaled_pressure_t& w) {
  if (!finite(w.press_abs, w.press_diff)) return std::nullopt;
  return AirPressure{w.time_boot_ms, w.press_abs, w.press_diff};
}

Decoded from_wire(const mavlink_vfr_hud_t& w) {
  if (!finite(w.airspeed, w.groundspeed, w.alt, w.climb)) return std::nullopt;
  return FlightFigures{w.airspeed, w.groundspeed, radians(w.heading), w.alt, w.climb};
}

Decoded from_wire(const mavlink_wind_t& w) {
  if (!finite(w.direction, w.speed)) return std::nullopt;
  return WindEstimate{radians(static_cast<double>(w.direction)), w.speed};
}

Decoded from_wire(const mavlink_terrain_report_t& w) {
  if (!finite(w.terrain_height, w.current_height)) return std::nullopt;
  if (w.spacing == 0) return OtherMessage{MAVLINK_MSG_ID_TERRAIN_REPORT};  // "not known there"
  return GroundHeight{place_e7(w.lat, w.lon), w.terrain_height, w.current_height};
}

Decoded from_wire(const mavlink_distance_sensor_t& w) {
  if (w.orientation != MAV_SENSOR_ROTATION_PITCH_270) return OtherMessage{MAVLINK_MSG_ID_DISTANCE_SENSOR};
  return GroundDistance{w.time_boot_ms, w.current_distance * 0.01, w.min_distance * 0.01, w.max_distance * 0.01};
}

Decoded from_wire(const mavlink_ekf_status_report_t& w) {
  if (!finite(w.velocity_variance, w.pos_horiz_variance, w.pos_vert_variance, w.compass_variance)) return std::nullopt;
  const auto has = [&](int flag) { return (w.flags & flag) != 0; };
  return EkfStatus{.attitude = has(EKF_ATTITUDE),
                   .horizontal_velocity = has(EKF_VELOCITY_HORIZ),
                   .horizontal_position_relative = has(EKF_POS_HORIZ_REL),
                   .horizontal_position_absolute = has(EKF_POS_HORIZ_ABS),
                   .vertical_position = has(EKF_POS_VERT_ABS),
                   .constant_position = has(EKF_CONST_POS_MODE),
                   .uninitialized = has(EKF_UNINITIALIZED),
                   .gps_glitching = has(EKF_GPS_GLITCHING),
                   .velocity_variance = w.velocity_variance,
                   .horizontal_position_variance = w.pos_horiz_variance,
                   .vertical_position_variance = w.pos_vert_variance,
                   .compass_variance = w.compass_variance};
}

Decoded from_wire(const mavlink_sys_status_t& w) {
  const auto gps = [](std::uint32_t sensors) { return (sensors & MAV_SYS_STATUS_SENSOR_GPS) != 0; };
  return SystemStatus{gps(w.onboard_control_sensors_present), gps(w.onboard_control_sensors_enabled),
                      gps(w.onboard_control_sensors_health)};
}

Decoded from_wire(const mavlink_statustext_t& w) {
  return StatusText{limited(w.severity, TextSeverity::debug), text_of(w.text), w.id, w.chunk_seq};
}

Decoded from_wire(const mavlink_param_value_t& w) {
  return ParameterValue{.name = text_of(w.param_id),
                        .value = w.param_value,
                        .type = w.param_type,
                        .count = w.param_count,
                        .index = w.param_index == UINT16_MAX ? -1 : w.param_index};
}

Decoded from_wire(const mavlink_command_long_t& w) {
  return CommandLong{{w.target_system, w.target_component},
                     w.command,
                     w.confirmation,
                     {w.param1, w.param2, w.param3, w.param4, w.param5, w.param6, w.param7}};
}

Decoded from_wire(const mavlink_command_int_t& w) {
  return CommandInt{{w.target_system, w.target_component},    w.command,          w.frame,
                    {w.param1, w.param2, w.param3, w.param4}, place_e7(w.x, w.y), w.z};
}

Decoded from_wire(const mavlink_command_ack_t& w) {
  // Later definitions have more results; all of them mean that it was not done.
  const auto result = w.result <= MAV_RESULT_IN_PROGRESS ? static_cast<CommandResult>(w.result) : CommandResult::failed;
  return CommandAck{w.command, result, {w.target_system, w.target_component}};
}

Decoded from_wire(const mavlink_autopilot_version_t& w) {
  AutopilotVersion version{.capabilities = w.capabilities,
                           .flight_software = w.flight_sw_version,
                           .board = w.board_version,
                           .vendor_id = w.vendor_id,
                           .product_id = w.product_id,
                           .uid = w.uid,
                           .uid2 = {}};
  static_assert(sizeof w.uid2 == sizeof version.uid2);
  std::copy(std::begin(w.uid2), std::end(w.uid2), version.uid2.begin());
  return version;
}

Decoded from_wire(const mavlink_sim_state_t& w) {
  const Vector3 acceleration{w.xacc, w.yacc, w.zacc};
  const Vector3 rate{w.xgyro, w.ygyro, w.zgyro};
  if (!finite(w.roll, w.pitch, w.yaw, w.lat, w.lon, w.alt) || !finite(w.vn, w.ve, w.vd) || !finite(acceleration) ||
      !finite(rate)) {
    return std::nullopt;
  }
  // The whole numbers are finer than the single floats, and absent in old senders.
  const bool fine = w.lat_int != 0 || w.lon_int != 0;
  return SimState{.roll_rad = w.roll,
                  .pitch_rad = w.pitch,
                  .yaw_rad = w.yaw,
                  .acceleration_m_s2 = acceleration,
                  .rate_rad_s = rate,
                  .place = fine ? place_e7(w.lat_int, w.lon_int) : LonLat{w.lon, w.lat},
                  .msl_m = w.alt,
                  .velocity = {w.vn, w.ve, w.vd}};
}

template <class Wire>
Decoded unpacked(const mavlink_message_t& message, void (*unpack)(const mavlink_message_t*, Wire*)) {
  Wire wire{};
  unpack(&message, &wire);
  return from_wire(wire);
}

}  // namespace

Decoded decode(const MavlinkFrame& frame) {
  mavlink_message_t message{};
  message.msgid = frame.message_id & 0xFFFFFFU;
  message.len = frame.bytes[1];
  const std::size_t header = frame.version == 2 ? MAVLINK_NUM_HEADER_BYTES : MAVLINK_CORE_HEADER_MAVLINK1_LEN + 1;
  std::memcpy(message.payload64, frame.bytes.data() + header, message.len);

  switch (frame.message_id) {
    case MAVLINK_MSG_ID_HEARTBEAT: return unpacked(message, mavlink_msg_heartbeat_decode);
    case MAVLINK_MSG_ID_SYSTEM_TIME: return unpacked(message, mavlink_msg_system_time_decode);
    case MAVLINK_MSG_ID_TIMESYNC: return unpacked(message, mavlink_msg_timesync_decode);
    case MAVLINK_MSG_ID_ATTITUDE: return unpacked(message, mavlink_msg_attitude_decode);
    case MAVLINK_MSG_ID_GLOBAL_POSITION_INT: return unpacked(message, mavlink_msg_global_position_int_decode);
    case MAVLINK_MSG_ID_GPS_RAW_INT: return unpacked(message, mavlink_msg_gps_raw_int_decode);
    case MAVLINK_MSG_ID_GPS2_RAW: return unpacked(message, mavlink_msg_gps2_raw_decode);
    case MAVLINK_MSG_ID_RAW_IMU: return unpacked(message, mavlink_msg_raw_imu_decode);
    case MAVLINK_MSG_ID_SCALED_IMU: return unpacked(message, mavlink_msg_scaled_imu_decode);
    case MAVLINK_MSG_ID_SCALED_IMU2: return unpacked(message, mavlink_msg_scaled_imu2_decode);
    case MAVLINK_MSG_ID_SCALED_IMU3: return unpacked(message, mavlink_msg_scaled_imu3_decode);
    case MAVLINK_MSG_ID_SCALED_PRESSURE: return unpacked(message, mavlink_msg_scaled_pressure_decode);
    case MAVLINK_MSG_ID_VFR_HUD: return unpacked(message, mavlink_msg_vfr_hud_decode);
    case MAVLINK_MSG_ID_WIND: return unpacked(message, mavlink_msg_wind_decode);
    case MAVLINK_MSG_ID_TERRAIN_REPORT: return unpacked(message, mavlink_msg_terrain_report_decode);
    case MAVLINK_MSG_ID_DISTANCE_SENSOR: return unpacked(message, mavlink_msg_distance_sensor_decode);
    case MAVLINK_MSG_ID_EKF_STATUS_REPORT: return unpacked(message, mavlink_msg_ekf_status_report_decode);
    case MAVLINK_MSG_ID_SYS_STATUS: return unpacked(message, mavlink_msg_sys_status_decode);
    case MAVLINK_MSG_ID_STATUSTEXT: return unpacked(message, mavlink_msg_statustext_decode);
    case MAVLINK_MSG_ID_PARAM_VALUE: return unpacked(message, mavlink_msg_param_value_decode);
    case MAVLINK_MSG_ID_COMMAND_LONG: return unpacked(message, mavlink_msg_command_long_decode);
    case MAVLINK_MSG_ID_COMMAND_INT: return unpacked(message, mavlink_msg_command_int_decode);
    case MAVLINK_MSG_ID_COMMAND_ACK: return unpacked(message, mavlink_msg_command_ack_decode);
    case MAVLINK_MSG_ID_AUTOPILOT_VERSION: return unpacked(message, mavlink_msg_autopilot_version_decode);
    case MAVLINK_MSG_ID_SIM_STATE: return unpacked(message, mavlink_msg_sim_state_decode);
    default: return OtherMessage{frame.message_id};
  }
}

}  // namespace nadir
