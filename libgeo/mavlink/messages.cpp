#include "mavlink/messages.hpp"

#include <ardupilotmega/mavlink.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "geodesy/angles.hpp"
#include "geodesy/gravity.hpp"
#include "mavlink/wire_message.hpp"

namespace nadir {
namespace {

using Decoded = std::optional<IncomingMessage>;

constexpr double kMaxQuaternionError = 0.01;  // of its length

static_assert(static_cast<int>(VideoStream::Kind::mpeg_ts) == VIDEO_STREAM_TYPE_MPEG_TS);
static_assert(static_cast<int>(GpsFix::rtk_fixed) == GPS_FIX_TYPE_RTK_FIXED);
static_assert(static_cast<int>(TextSeverity::debug) == MAV_SEVERITY_DEBUG);
static_assert(static_cast<int>(SystemState::emergency) == MAV_STATE_EMERGENCY);
static_assert(static_cast<int>(CommandResult::in_progress) == MAV_RESULT_IN_PROGRESS);

template <class... Numbers>
bool finite(Numbers... numbers) {
  return (std::isfinite(numbers) && ...);
}

bool finite(const Vector3& v) { return finite(v.x, v.y, v.z); }

// Values above the last enumerator become the last.
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

AutopilotType autopilot_type(std::uint8_t number) {
  switch (number) {
    case MAV_AUTOPILOT_INVALID: return AutopilotType::none;
    case MAV_AUTOPILOT_ARDUPILOTMEGA: return AutopilotType::ardupilot;
    case MAV_AUTOPILOT_PX4: return AutopilotType::px4;
    default: return AutopilotType::other;
  }
}

Decoded from_wire(const mavlink_heartbeat_t& w) {
  return Heartbeat{.vehicle_type = w.type,
                   .is_autopilot = w.autopilot != MAV_AUTOPILOT_INVALID,
                   .autopilot = autopilot_type(w.autopilot),
                   .autopilot_number = w.autopilot,
                   .armed = (w.base_mode & MAV_MODE_FLAG_SAFETY_ARMED) != 0,
                   .custom_mode = w.custom_mode,
                   .state = limited(w.system_status, SystemState::emergency)};
}

Decoded from_wire(const mavlink_system_time_t& w) {
  SystemTime time{.unix_us = std::nullopt, .boot_ms = w.time_boot_ms};
  // Until it knows the date the autopilot sends zero or its uptime.
  constexpr std::uint64_t kYear2015 = 1420070400000000;
  if (w.time_unix_usec >= kYear2015 && w.time_unix_usec < UINT64_MAX / 4) {
    time.unix_us = static_cast<std::int64_t>(w.time_unix_usec);
  }
  return time;
}

Decoded from_wire(const mavlink_attitude_t& w) {
  const Vector3 rate{w.rollspeed, w.pitchspeed, w.yawspeed};
  if (!finite(w.roll, w.pitch, w.yaw) || !finite(rate)) return std::nullopt;
  return AircraftAttitude{w.time_boot_ms, w.roll, w.pitch, w.yaw, rate};
}

// Roll and pitch are those to the horizon, whatever the flags; they say what yaw counts from. Without either of the two
// newer flags yaw counts from north where it is locked.
Decoded from_wire(const mavlink_gimbal_device_attitude_status_t& w) {
  const auto has = [&](unsigned flag) { return (w.flags & flag) != 0; };
  const bool from_heading = has(GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME);
  const bool from_north = has(GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME);
  if (!finite(w.q[0], w.q[1], w.q[2], w.q[3]) || (from_heading && from_north)) return std::nullopt;
  const std::array<double, 4> q{w.q[0], w.q[1], w.q[2], w.q[3]};
  const double length = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  if (!(std::abs(length - 1) < kMaxQuaternionError)) return std::nullopt;
  constexpr std::uint32_t kFaults = GIMBAL_DEVICE_ERROR_FLAGS_ENCODER_ERROR | GIMBAL_DEVICE_ERROR_FLAGS_SOFTWARE_ERROR |
                                    GIMBAL_DEVICE_ERROR_FLAGS_COMMS_ERROR |
                                    GIMBAL_DEVICE_ERROR_FLAGS_CALIBRATION_RUNNING;
  return GimbalAttitude{.boot_ms = w.time_boot_ms,
                        .device = w.gimbal_device_id,
                        .level_from_gimbal = {q[0] / length, q[1] / length, q[2] / length, q[3] / length},
                        .from_north = from_north || (!from_heading && has(GIMBAL_DEVICE_FLAGS_YAW_LOCK)),
                        .faulty = (w.failure_flags & kFaults) != 0};
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
             .ground_speed_mps = scaled_unless(w.vel, UINT16_MAX, 0.01),
             .course_rad = heading_cdeg(w.cog),
             .satellites = std::nullopt,
             .horizontal_accuracy_m = scaled_unless(w.h_acc, 0, 1e-3),
             .vertical_accuracy_m = scaled_unless(w.v_acc, 0, 1e-3),
             .speed_accuracy_mps = scaled_unless(w.vel_acc, 0, 1e-3),
             .yaw_rad = std::nullopt};
  if (w.satellites_visible != UINT8_MAX) raw.satellites = w.satellites_visible;
  if (w.yaw != 0) raw.yaw_rad = heading_cdeg(w.yaw);  // 0: none, 36000: north
  return raw;
}

Decoded from_wire(const mavlink_gps_raw_int_t& w) { return gps_raw(w, 1); }
Decoded from_wire(const mavlink_gps2_raw_t& w) { return gps_raw(w, 2); }

template <class Wire>
ImuSample imu_sample(const Wire& w, int instance, std::uint64_t time_us) {
  constexpr double kAcceleration = kStandardGravity_mps2 * 1e-3;
  return {.instance = instance,
          .time_us = time_us,
          .acceleration_mps2 = {w.xacc * kAcceleration, w.yacc * kAcceleration, w.zacc * kAcceleration},
          .rate_rad_s = {w.xgyro * 1e-3, w.ygyro * 1e-3, w.zgyro * 1e-3}};
}

Decoded from_wire(const mavlink_raw_imu_t& w) { return imu_sample(w, w.id + 1, w.time_usec); }
Decoded from_wire(const mavlink_scaled_imu_t& w) { return imu_sample(w, 1, w.time_boot_ms * 1000ULL); }
Decoded from_wire(const mavlink_highres_imu_t& w) {
  const Vector3 acceleration{w.xacc, w.yacc, w.zacc}, rate{w.xgyro, w.ygyro, w.zgyro};
  if (!finite(acceleration) || !finite(rate)) return std::nullopt;
  return ImuSample{w.id + 1, w.time_usec, acceleration, rate};
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

Decoded from_wire(const mavlink_estimator_status_t& w) {
  return EstimatorStatus{.horizontal_position_absolute = (w.flags & ESTIMATOR_POS_HORIZ_ABS) != 0,
                         .gps_glitching = (w.flags & ESTIMATOR_GPS_GLITCH) != 0,
                         .horizontal_position_ratio = w.pos_horiz_ratio,
                         .horizontal_accuracy_m = w.pos_horiz_accuracy};
}

Decoded from_wire(const mavlink_gps_global_origin_t& w) {
  return LocalOrigin{place_e7(w.latitude, w.longitude), w.altitude * 1e-3};
}

Decoded from_wire(const mavlink_statustext_t& w) {
  return StatusText{limited(w.severity, TextSeverity::debug), text_of(w.text), w.id, w.chunk_seq};
}

Decoded from_wire(const mavlink_param_value_t& w) {
  return ParameterValue{.name = text_of(w.param_id),
                        .wire_value = w.param_value,
                        .type = w.param_type,
                        .count = w.param_count,
                        .index = w.param_index == UINT16_MAX ? -1 : w.param_index};
}

Decoded from_wire(const mavlink_command_int_t& w) {
  return CommandInt{{w.target_system, w.target_component},    w.command,          w.frame,
                    {w.param1, w.param2, w.param3, w.param4}, place_e7(w.x, w.y), w.z};
}

Decoded from_wire(const mavlink_command_long_t& w) {
  return CommandLong{{w.target_system, w.target_component},
                     w.command,
                     w.confirmation,
                     {w.param1, w.param2, w.param3, w.param4, w.param5, w.param6, w.param7}};
}

Decoded from_wire(const mavlink_set_gps_global_origin_t& w) {
  return SetLocalOrigin{w.target_system, place_e7(w.latitude, w.longitude), w.altitude * 1e-3};
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

template <std::size_t size>
std::string text_of(const std::uint8_t (&field)[size]) {
  return {std::begin(field), std::find(std::begin(field), std::end(field), std::uint8_t{0})};
}

Decoded from_wire(const mavlink_camera_information_t& w) {
  return CameraInformation{text_of(w.vendor_name), text_of(w.model_name),
                           (w.flags & CAMERA_CAP_FLAGS_HAS_VIDEO_STREAM) != 0};
}

Decoded from_wire(const mavlink_video_stream_information_t& w) {
  return VideoStream{.kind = limited(w.type, VideoStream::Kind::other),
                     .id = w.stream_id,
                     .count = w.count,
                     .width = w.resolution_h,
                     .height = w.resolution_v,
                     .running = (w.flags & VIDEO_STREAM_STATUS_FLAGS_RUNNING) != 0,
                     .name = text_of(w.name),
                     .uri = text_of(w.uri)};
}

Decoded from_wire(const mavlink_sim_state_t& w) {
  const Vector3 acceleration{w.xacc, w.yacc, w.zacc};
  const Vector3 rate{w.xgyro, w.ygyro, w.zgyro};
  if (!finite(w.roll, w.pitch, w.yaw, w.lat, w.lon, w.alt) || !finite(w.vn, w.ve, w.vd) || !finite(acceleration) ||
      !finite(rate)) {
    return std::nullopt;
  }
  // The integers are more precise than the floats; old senders leave them zero.
  const bool fine = w.lat_int != 0 || w.lon_int != 0;
  return SimState{.roll_rad = w.roll,
                  .pitch_rad = w.pitch,
                  .yaw_rad = w.yaw,
                  .acceleration_mps2 = acceleration,
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

// ---- encoding

// Rounded and clamped to the range of the field; zero for NaN.
template <class Field>
Field rounded(double value) {
  if (std::isnan(value)) return 0;
  const double low = static_cast<double>(std::numeric_limits<Field>::min());
  const double high = static_cast<double>(std::numeric_limits<Field>::max());
  return static_cast<Field>(std::lround(std::clamp(value, low, high)));
}

template <std::size_t size>
void put_text(char (&field)[size], std::string_view text) {
  std::size_t length = std::min(text.size(), size);
  // Not in the middle of a UTF-8 character.
  while (length < text.size() && length > 0 && (static_cast<unsigned char>(text[length]) & 0xC0U) == 0x80U) --length;
  std::memcpy(field, text.data(), length);
}

constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();

float or_unknown(std::optional<double> value) { return value ? static_cast<float>(*value) : kUnknown; }

// 0 means "no yaw"; north is 36000.
std::uint16_t yaw_cdeg(std::optional<double> yaw_rad) {
  if (!yaw_rad || !std::isfinite(*yaw_rad)) return 0;
  const auto cdeg = static_cast<int>(std::lround(degrees(wrap_pi(*yaw_rad)) * 100.0));
  return static_cast<std::uint16_t>(cdeg <= 0 ? cdeg + 36000 : cdeg);
}

class Writer {
 public:
  Writer(MavlinkAddress from, std::uint8_t sequence) : from_(from) { status_.current_tx_seq = sequence; }

  template <class Wire>
  Bytes pack(std::uint16_t (*encode)(std::uint8_t, std::uint8_t, mavlink_status_t*, mavlink_message_t*, const Wire*),
             const Wire& wire) {
    mavlink_message_t message{};
    encode(from_.system, from_.component, &status_, &message, &wire);
    Bytes bytes(MAVLINK_MAX_PACKET_LEN);
    bytes.resize(mavlink_msg_to_send_buffer(bytes.data(), &message));
    return bytes;
  }

  Bytes operator()(const OwnHeartbeat& m) {
    mavlink_heartbeat_t w{};
    w.type = MAV_TYPE_ONBOARD_CONTROLLER;
    w.autopilot = MAV_AUTOPILOT_INVALID;
    w.system_status = static_cast<std::uint8_t>(m.state);
    w.mavlink_version = MAVLINK_VERSION;
    return pack(mavlink_msg_heartbeat_encode_status, w);
  }

  Bytes operator()(const GpsInput& m) {
    mavlink_gps_input_t w{};
    std::uint32_t ignore = 0;
    const auto given = [&ignore](const std::optional<double>& value, std::uint32_t flag) {
      if (!value) ignore |= flag;
      return static_cast<float>(value.value_or(0));
    };
    w.time_usec = static_cast<std::uint64_t>(std::max<std::int64_t>(m.unix_us, 0));
    w.time_week = m.gps_week;
    w.time_week_ms = m.gps_week_ms;
    w.gps_id = m.gps_id;
    w.fix_type = static_cast<std::uint8_t>(m.fix);
    w.lat = rounded<std::int32_t>(m.place.lat_deg * 1e7);
    w.lon = rounded<std::int32_t>(m.place.lon_deg * 1e7);
    w.alt = given(m.msl_m, GPS_INPUT_IGNORE_FLAG_ALT);
    w.hdop = given(m.hdop, GPS_INPUT_IGNORE_FLAG_HDOP);
    w.vdop = given(m.vdop, GPS_INPUT_IGNORE_FLAG_VDOP);
    w.horiz_accuracy = given(m.horizontal_accuracy_m, GPS_INPUT_IGNORE_FLAG_HORIZONTAL_ACCURACY);
    w.vert_accuracy = given(m.vertical_accuracy_m, GPS_INPUT_IGNORE_FLAG_VERTICAL_ACCURACY);
    w.speed_accuracy = given(m.speed_accuracy_mps, GPS_INPUT_IGNORE_FLAG_SPEED_ACCURACY);
    if (!m.velocity) ignore |= GPS_INPUT_IGNORE_FLAG_VEL_HORIZ;
    const GpsVelocity velocity = m.velocity.value_or(GpsVelocity{});
    w.vn = static_cast<float>(velocity.north_mps);
    w.ve = static_cast<float>(velocity.east_mps);
    w.vd = given(velocity.down_mps, GPS_INPUT_IGNORE_FLAG_VEL_VERT);
    w.ignore_flags = static_cast<std::uint16_t>(ignore);
    w.satellites_visible = rounded<std::uint8_t>(m.satellites);
    w.yaw = yaw_cdeg(m.yaw_rad);
    return pack(mavlink_msg_gps_input_encode_status, w);
  }

  Bytes operator()(const GlobalPositionSensor& m) {
    mavlink_global_position_sensor_t w{};
    w.target_system = m.target.system;
    w.target_component = m.target.component;
    w.id = m.sensor_id;
    w.time_usec = static_cast<std::uint64_t>(std::max<std::int64_t>(m.unix_us, 0));
    w.processing_time = rounded<std::uint32_t>(m.processing_s * 1e6);
    w.source = GLOBAL_POSITION_SRC_VISION;
    w.lat = rounded<std::int32_t>(m.place.lat_deg * 1e7);
    w.lon = rounded<std::int32_t>(m.place.lon_deg * 1e7);
    w.alt_ellipsoid = kUnknown;
    w.alt = or_unknown(m.msl_m);
    w.eph = static_cast<float>(m.sigma_m);
    w.epv = or_unknown(m.vertical_sigma_m);
    return pack(mavlink_msg_global_position_sensor_encode_status, w);
  }

  Bytes operator()(const LocalPosition& m) {
    mavlink_odometry_t w{};
    w.time_usec = static_cast<std::uint64_t>(std::max<std::int64_t>(m.unix_us, 0));
    w.frame_id = MAV_FRAME_LOCAL_NED;
    w.child_frame_id = MAV_FRAME_BODY_FRD;
    w.x = static_cast<float>(m.north_m);
    w.y = static_cast<float>(m.east_m);
    w.z = static_cast<float>(m.down_m);
    std::ranges::fill(w.q, kUnknown);
    w.vx = w.vy = w.vz = w.rollspeed = w.pitchspeed = w.yawspeed = kUnknown;
    // Rows of the upper right triangle, of x, y, z, roll, pitch, yaw.
    std::ranges::fill(w.pose_covariance, kUnknown);
    std::ranges::fill(w.velocity_covariance, kUnknown);
    const auto variance = [](double sigma) { return static_cast<float>(sigma * sigma); };
    w.pose_covariance[0] = w.pose_covariance[6] = variance(m.sigma_m);
    w.pose_covariance[1] = w.pose_covariance[2] = w.pose_covariance[7] = 0;
    w.pose_covariance[11] = variance(m.vertical_sigma_m);
    w.reset_counter = m.reset_counter;
    w.estimator_type = MAV_ESTIMATOR_TYPE_VISION;
    return pack(mavlink_msg_odometry_encode_status, w);
  }

  Bytes operator()(const SetLocalOrigin& m) {
    mavlink_set_gps_global_origin_t w{};
    w.target_system = m.target_system;
    w.latitude = rounded<std::int32_t>(m.place.lat_deg * 1e7);
    w.longitude = rounded<std::int32_t>(m.place.lon_deg * 1e7);
    w.altitude = rounded<std::int32_t>(m.msl_m * 1e3);
    return pack(mavlink_msg_set_gps_global_origin_encode_status, w);
  }

  Bytes operator()(const NamedValue& m) {
    mavlink_named_value_float_t w{};
    w.time_boot_ms = m.boot_ms;
    put_text(w.name, m.name);
    w.value = m.value;
    return pack(mavlink_msg_named_value_float_encode_status, w);
  }

  Bytes operator()(const StatusText& m) {
    mavlink_statustext_t w{};
    w.severity = static_cast<std::uint8_t>(m.severity);
    put_text(w.text, m.text);
    w.id = m.id;
    w.chunk_seq = m.chunk;
    return pack(mavlink_msg_statustext_encode_status, w);
  }

  Bytes operator()(const CommandLong& m) {
    mavlink_command_long_t w{};
    w.target_system = m.target.system;
    w.target_component = m.target.component;
    w.command = m.command;
    w.confirmation = m.confirmation;
    const auto& p = m.parameters;
    w.param1 = p[0];
    w.param2 = p[1];
    w.param3 = p[2];
    w.param4 = p[3];
    w.param5 = p[4];
    w.param6 = p[5];
    w.param7 = p[6];
    return pack(mavlink_msg_command_long_encode_status, w);
  }

  Bytes operator()(const CommandInt& m) {
    mavlink_command_int_t w{};
    w.target_system = m.target.system;
    w.target_component = m.target.component;
    w.command = m.command;
    w.frame = m.frame;
    w.param1 = m.parameters[0];
    w.param2 = m.parameters[1];
    w.param3 = m.parameters[2];
    w.param4 = m.parameters[3];
    w.x = rounded<std::int32_t>(m.place.lat_deg * 1e7);
    w.y = rounded<std::int32_t>(m.place.lon_deg * 1e7);
    w.z = m.z;
    return pack(mavlink_msg_command_int_encode_status, w);
  }

  Bytes operator()(const CommandAck& m) {
    mavlink_command_ack_t w{};
    w.command = m.command;
    w.result = static_cast<std::uint8_t>(m.result);
    w.target_system = m.target.system;
    w.target_component = m.target.component;
    return pack(mavlink_msg_command_ack_encode_status, w);
  }

  Bytes operator()(const ParameterRequest& m) {
    mavlink_param_request_read_t w{};
    w.target_system = m.target.system;
    w.target_component = m.target.component;
    put_text(w.param_id, m.name);
    w.param_index = -1;  // by name
    return pack(mavlink_msg_param_request_read_encode_status, w);
  }

  Bytes operator()(const ParameterSet& m) {
    mavlink_param_set_t w{};
    w.target_system = m.target.system;
    w.target_component = m.target.component;
    put_text(w.param_id, m.name);
    w.param_value = m.wire_value;
    w.param_type = m.type;
    return pack(mavlink_msg_param_set_encode_status, w);
  }

  Bytes operator()(const SigningSetup& m) {
    mavlink_setup_signing_t w{};
    w.target_system = m.target.system;
    w.target_component = m.target.component;
    static_assert(sizeof w.secret_key == sizeof m.key);
    std::copy(m.key.begin(), m.key.end(), std::begin(w.secret_key));
    w.initial_timestamp = m.timestamp_10us;
    return pack(mavlink_msg_setup_signing_encode_status, w);
  }

 private:
  MavlinkAddress from_;
  mavlink_status_t status_{};
};

}  // namespace

std::optional<IncomingMessage> decode(const MavlinkFrame& frame) {
  const mavlink_message_t message = wire_message(frame);
  switch (frame.message_id) {
    case MAVLINK_MSG_ID_HEARTBEAT: return unpacked(message, mavlink_msg_heartbeat_decode);
    case MAVLINK_MSG_ID_SYSTEM_TIME: return unpacked(message, mavlink_msg_system_time_decode);
    case MAVLINK_MSG_ID_ATTITUDE: return unpacked(message, mavlink_msg_attitude_decode);
    case MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS:
      return unpacked(message, mavlink_msg_gimbal_device_attitude_status_decode);
    case MAVLINK_MSG_ID_GLOBAL_POSITION_INT: return unpacked(message, mavlink_msg_global_position_int_decode);
    case MAVLINK_MSG_ID_GPS_RAW_INT: return unpacked(message, mavlink_msg_gps_raw_int_decode);
    case MAVLINK_MSG_ID_GPS2_RAW: return unpacked(message, mavlink_msg_gps2_raw_decode);
    case MAVLINK_MSG_ID_RAW_IMU: return unpacked(message, mavlink_msg_raw_imu_decode);
    case MAVLINK_MSG_ID_SCALED_IMU: return unpacked(message, mavlink_msg_scaled_imu_decode);
    case MAVLINK_MSG_ID_HIGHRES_IMU: return unpacked(message, mavlink_msg_highres_imu_decode);
    case MAVLINK_MSG_ID_TERRAIN_REPORT: return unpacked(message, mavlink_msg_terrain_report_decode);
    case MAVLINK_MSG_ID_DISTANCE_SENSOR: return unpacked(message, mavlink_msg_distance_sensor_decode);
    case MAVLINK_MSG_ID_EKF_STATUS_REPORT: return unpacked(message, mavlink_msg_ekf_status_report_decode);
    case MAVLINK_MSG_ID_ESTIMATOR_STATUS: return unpacked(message, mavlink_msg_estimator_status_decode);
    case MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: return unpacked(message, mavlink_msg_gps_global_origin_decode);
    case MAVLINK_MSG_ID_STATUSTEXT: return unpacked(message, mavlink_msg_statustext_decode);
    case MAVLINK_MSG_ID_PARAM_VALUE: return unpacked(message, mavlink_msg_param_value_decode);
    case MAVLINK_MSG_ID_COMMAND_INT: return unpacked(message, mavlink_msg_command_int_decode);
    case MAVLINK_MSG_ID_COMMAND_LONG: return unpacked(message, mavlink_msg_command_long_decode);
    case MAVLINK_MSG_ID_SET_GPS_GLOBAL_ORIGIN: return unpacked(message, mavlink_msg_set_gps_global_origin_decode);
    case MAVLINK_MSG_ID_AUTOPILOT_VERSION: return unpacked(message, mavlink_msg_autopilot_version_decode);
    case MAVLINK_MSG_ID_CAMERA_INFORMATION: return unpacked(message, mavlink_msg_camera_information_decode);
    case MAVLINK_MSG_ID_VIDEO_STREAM_INFORMATION: return unpacked(message, mavlink_msg_video_stream_information_decode);
    case MAVLINK_MSG_ID_SIM_STATE: return unpacked(message, mavlink_msg_sim_state_decode);
    default: return OtherMessage{frame.message_id};
  }
}

Bytes encode(const OutgoingMessage& message, MavlinkAddress from, std::uint8_t sequence) {
  return std::visit(Writer(from, sequence), message);
}

}  // namespace nadir
