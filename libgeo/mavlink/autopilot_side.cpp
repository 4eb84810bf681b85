#include "mavlink/autopilot_side.hpp"

#include <ardupilotmega/mavlink.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>

#include "geodesy/angles.hpp"
#include "geodesy/gravity.hpp"
#include "mavlink/wire_message.hpp"

namespace nadir {
namespace {

constexpr double kMilliG_mps2 = kStandardGravity_mps2 / 1000;

template <class Field>
Field clamped(double value) {
  if (std::isnan(value)) return 0;
  return static_cast<Field>(std::llround(std::clamp(value, static_cast<double>(std::numeric_limits<Field>::min()),
                                                    static_cast<double>(std::numeric_limits<Field>::max()))));
}

std::int32_t e7_of(double degrees) { return clamped<std::int32_t>(degrees * 1e7); }

// 0 to 35999; UINT16_MAX: unknown.
std::uint16_t cdeg_of(const std::optional<double>& angle_rad) {
  if (!angle_rad) return UINT16_MAX;
  const double turned = std::fmod(degrees(*angle_rad) + 360, 360);
  return static_cast<std::uint16_t>(std::lround(turned * 100) % 36000);
}

std::uint16_t or_max(const std::optional<double>& value, double scale) {
  return value ? std::min<std::uint16_t>(clamped<std::uint16_t>(*value * scale), UINT16_MAX - 1) : UINT16_MAX;
}

class AutopilotWriter {
 public:
  AutopilotWriter(AutopilotType type, MavlinkAddress from, std::uint8_t sequence) : type_(type), from_(from) {
    status_.current_tx_seq = sequence;
  }

  using Encoded = std::optional<Bytes>;

  template <class Unsent>
  Encoded operator()(const Unsent&) {
    return std::nullopt;
  }

  Encoded operator()(const Heartbeat& m) {
    mavlink_heartbeat_t w{};
    w.type = m.vehicle_type;
    w.autopilot = type_ == AutopilotType::px4 ? MAV_AUTOPILOT_PX4 : MAV_AUTOPILOT_ARDUPILOTMEGA;
    w.base_mode = MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | MAV_MODE_FLAG_AUTO_ENABLED;
    if (m.armed) w.base_mode |= MAV_MODE_FLAG_SAFETY_ARMED;
    w.custom_mode = m.custom_mode;
    w.system_status = static_cast<std::uint8_t>(m.state);
    w.mavlink_version = MAVLINK_VERSION;
    return pack(mavlink_msg_heartbeat_encode_status, w);
  }

  Encoded operator()(const SystemTime& m) {
    mavlink_system_time_t w{};
    w.time_unix_usec = static_cast<std::uint64_t>(m.unix_us.value_or(0));
    w.time_boot_ms = m.boot_ms;
    return pack(mavlink_msg_system_time_encode_status, w);
  }

  Encoded operator()(const AircraftAttitude& m) {
    mavlink_attitude_t w{};
    w.time_boot_ms = m.boot_ms;
    w.roll = static_cast<float>(m.roll_rad);
    w.pitch = static_cast<float>(m.pitch_rad);
    w.yaw = static_cast<float>(m.yaw_rad);
    w.rollspeed = static_cast<float>(m.rate_rad_s.x);
    w.pitchspeed = static_cast<float>(m.rate_rad_s.y);
    w.yawspeed = static_cast<float>(m.rate_rad_s.z);
    return pack(mavlink_msg_attitude_encode_status, w);
  }

  Encoded operator()(const GlobalPosition& m) {
    mavlink_global_position_int_t w{};
    w.time_boot_ms = m.boot_ms;
    w.lat = e7_of(m.place.lat_deg);
    w.lon = e7_of(m.place.lon_deg);
    w.alt = clamped<std::int32_t>(m.msl_m * 1e3);
    w.relative_alt = clamped<std::int32_t>(m.above_home_m * 1e3);
    w.vx = clamped<std::int16_t>(m.velocity.north_mps * 100);
    w.vy = clamped<std::int16_t>(m.velocity.east_mps * 100);
    w.vz = clamped<std::int16_t>(m.velocity.down_mps * 100);
    w.hdg = cdeg_of(m.heading_rad);
    return pack(mavlink_msg_global_position_int_encode_status, w);
  }

  Encoded operator()(const GpsRaw& m) {
    if (m.receiver == 2) return pack(mavlink_msg_gps2_raw_encode_status, raw<mavlink_gps2_raw_t>(m));
    return pack(mavlink_msg_gps_raw_int_encode_status, raw<mavlink_gps_raw_int_t>(m));
  }

  Encoded operator()(const ImuSample& m) {
    const Vector3 &force = m.acceleration_mps2, &rate = m.rate_rad_s;
    if (type_ == AutopilotType::px4) {
      mavlink_highres_imu_t w{};
      w.time_usec = m.time_us;
      w.xacc = static_cast<float>(force.x);
      w.yacc = static_cast<float>(force.y);
      w.zacc = static_cast<float>(force.z);
      w.xgyro = static_cast<float>(rate.x);
      w.ygyro = static_cast<float>(rate.y);
      w.zgyro = static_cast<float>(rate.z);
      w.id = static_cast<std::uint8_t>(m.instance - 1);
      return pack(mavlink_msg_highres_imu_encode_status, w);
    }
    mavlink_raw_imu_t w{};
    w.time_usec = m.time_us;
    w.xacc = clamped<std::int16_t>(force.x / kMilliG_mps2);
    w.yacc = clamped<std::int16_t>(force.y / kMilliG_mps2);
    w.zacc = clamped<std::int16_t>(force.z / kMilliG_mps2);
    w.xgyro = clamped<std::int16_t>(rate.x * 1e3);
    w.ygyro = clamped<std::int16_t>(rate.y * 1e3);
    w.zgyro = clamped<std::int16_t>(rate.z * 1e3);
    w.id = static_cast<std::uint8_t>(m.instance - 1);
    return pack(mavlink_msg_raw_imu_encode_status, w);
  }

  Encoded operator()(const EkfStatus& m) {
    mavlink_ekf_status_report_t w{};
    const auto flag = [&](bool on, int bit) { w.flags = static_cast<std::uint16_t>(w.flags | (on ? bit : 0)); };
    flag(m.attitude, EKF_ATTITUDE);
    flag(m.horizontal_velocity, EKF_VELOCITY_HORIZ);
    flag(m.horizontal_position_relative, EKF_POS_HORIZ_REL);
    flag(m.horizontal_position_absolute, EKF_POS_HORIZ_ABS);
    flag(m.vertical_position, EKF_POS_VERT_ABS);
    flag(m.constant_position, EKF_CONST_POS_MODE);
    flag(m.uninitialized, EKF_UNINITIALIZED);
    flag(m.gps_glitching, EKF_GPS_GLITCHING);
    w.velocity_variance = static_cast<float>(m.velocity_variance);
    w.pos_horiz_variance = static_cast<float>(m.horizontal_position_variance);
    w.pos_vert_variance = static_cast<float>(m.vertical_position_variance);
    w.compass_variance = static_cast<float>(m.compass_variance);
    return pack(mavlink_msg_ekf_status_report_encode_status, w);
  }

  Encoded operator()(const EstimatorStatus& m) {
    mavlink_estimator_status_t w{};
    const int flags =
        (m.horizontal_position_absolute ? ESTIMATOR_POS_HORIZ_ABS : 0) | (m.gps_glitching ? ESTIMATOR_GPS_GLITCH : 0);
    w.flags = static_cast<std::uint16_t>(flags);
    w.pos_horiz_ratio = static_cast<float>(m.horizontal_position_ratio);
    w.pos_horiz_accuracy = static_cast<float>(m.horizontal_accuracy_m);
    return pack(mavlink_msg_estimator_status_encode_status, w);
  }

  Encoded operator()(const ParameterValue& m) {
    mavlink_param_value_t w{};
    std::memcpy(w.param_id, m.name.data(), std::min(m.name.size(), sizeof w.param_id));
    w.param_value = m.wire_value;
    w.param_type = m.type;
    w.param_count = static_cast<std::uint16_t>(m.count);
    w.param_index = m.index < 0 ? UINT16_MAX : static_cast<std::uint16_t>(m.index);
    return pack(mavlink_msg_param_value_encode_status, w);
  }

  Encoded operator()(const AutopilotVersion& m) {
    mavlink_autopilot_version_t w{};
    w.capabilities = m.capabilities;
    w.flight_sw_version = m.flight_software;
    w.board_version = m.board;
    w.vendor_id = m.vendor_id;
    w.product_id = m.product_id;
    w.uid = m.uid;
    std::ranges::copy(m.uid2, std::begin(w.uid2));
    return pack(mavlink_msg_autopilot_version_encode_status, w);
  }

  Encoded operator()(const SimState& m) {
    mavlink_sim_state_t w{};
    w.q1 = 1;
    w.roll = static_cast<float>(m.roll_rad);
    w.pitch = static_cast<float>(m.pitch_rad);
    w.yaw = static_cast<float>(m.yaw_rad);
    w.xacc = static_cast<float>(m.acceleration_mps2.x);
    w.yacc = static_cast<float>(m.acceleration_mps2.y);
    w.zacc = static_cast<float>(m.acceleration_mps2.z);
    w.xgyro = static_cast<float>(m.rate_rad_s.x);
    w.ygyro = static_cast<float>(m.rate_rad_s.y);
    w.zgyro = static_cast<float>(m.rate_rad_s.z);
    w.lat = static_cast<float>(m.place.lat_deg);
    w.lon = static_cast<float>(m.place.lon_deg);
    w.lat_int = e7_of(m.place.lat_deg);
    w.lon_int = e7_of(m.place.lon_deg);
    w.alt = static_cast<float>(m.msl_m);
    w.vn = static_cast<float>(m.velocity.north_mps);
    w.ve = static_cast<float>(m.velocity.east_mps);
    w.vd = static_cast<float>(m.velocity.down_mps);
    return pack(mavlink_msg_sim_state_encode_status, w);
  }

 private:
  template <class Wire>
  static Wire raw(const GpsRaw& m) {
    Wire w{};
    w.time_usec = m.time_us;
    w.fix_type = static_cast<std::uint8_t>(m.fix);
    w.lat = e7_of(m.place.lat_deg);
    w.lon = e7_of(m.place.lon_deg);
    w.alt = clamped<std::int32_t>(m.msl_m * 1e3);
    w.eph = or_max(m.hdop, 100);
    w.epv = or_max(m.vdop, 100);
    w.vel = or_max(m.ground_speed_mps, 100);
    w.cog = cdeg_of(m.course_rad);
    w.satellites_visible = m.satellites ? clamped<std::uint8_t>(*m.satellites) : UINT8_MAX;
    w.h_acc = clamped<std::uint32_t>(m.horizontal_accuracy_m.value_or(0) * 1e3);
    w.v_acc = clamped<std::uint32_t>(m.vertical_accuracy_m.value_or(0) * 1e3);
    w.vel_acc = clamped<std::uint32_t>(m.speed_accuracy_mps.value_or(0) * 1e3);
    return w;
  }

  template <class Wire>
  Bytes pack(std::uint16_t (*encode)(std::uint8_t, std::uint8_t, mavlink_status_t*, mavlink_message_t*, const Wire*),
             const Wire& wire) {
    mavlink_message_t message{};
    encode(from_.system, from_.component, &status_, &message, &wire);
    Bytes bytes(MAVLINK_MAX_PACKET_LEN);
    bytes.resize(mavlink_msg_to_send_buffer(bytes.data(), &message));
    return bytes;
  }

  AutopilotType type_;
  MavlinkAddress from_;
  mavlink_status_t status_{};
};

std::string name_in(const char (&field)[16]) { return {field, strnlen(field, sizeof field)}; }

CompanionMessage read(const mavlink_gps_input_t& w) {
  const auto unless_ignored = [&](double value, int flag) {
    return (w.ignore_flags & flag) != 0 ? std::nullopt : std::optional(value);
  };
  GpsInput m{.unix_us = static_cast<std::int64_t>(w.time_usec),
             .gps_week = w.time_week,
             .gps_week_ms = w.time_week_ms,
             .gps_id = w.gps_id,
             .fix = static_cast<GpsFix>(std::min<std::uint8_t>(w.fix_type, GPS_FIX_TYPE_RTK_FIXED)),
             .place = {w.lon * 1e-7, w.lat * 1e-7},
             .msl_m = unless_ignored(w.alt, GPS_INPUT_IGNORE_FLAG_ALT),
             .hdop = unless_ignored(w.hdop, GPS_INPUT_IGNORE_FLAG_HDOP),
             .vdop = unless_ignored(w.vdop, GPS_INPUT_IGNORE_FLAG_VDOP),
             .velocity = std::nullopt,
             .horizontal_accuracy_m = unless_ignored(w.horiz_accuracy, GPS_INPUT_IGNORE_FLAG_HORIZONTAL_ACCURACY),
             .vertical_accuracy_m = unless_ignored(w.vert_accuracy, GPS_INPUT_IGNORE_FLAG_VERTICAL_ACCURACY),
             .speed_accuracy_mps = unless_ignored(w.speed_accuracy, GPS_INPUT_IGNORE_FLAG_SPEED_ACCURACY),
             .satellites = w.satellites_visible,
             .yaw_rad = std::nullopt};
  if ((w.ignore_flags & GPS_INPUT_IGNORE_FLAG_VEL_HORIZ) == 0) {
    m.velocity = GpsVelocity{w.vn, w.ve, unless_ignored(w.vd, GPS_INPUT_IGNORE_FLAG_VEL_VERT)};
  }
  if (w.yaw != 0) m.yaw_rad = wrap_pi(radians(w.yaw * 0.01));
  const bool numbers = std::isfinite(w.alt) && std::isfinite(w.hdop) && std::isfinite(w.vdop) && std::isfinite(w.vn) &&
                       std::isfinite(w.ve) && std::isfinite(w.vd) && std::isfinite(w.horiz_accuracy) &&
                       std::isfinite(w.vert_accuracy) && std::isfinite(w.speed_accuracy);
  if (!numbers) return {};
  return m;
}

CompanionMessage read(const mavlink_global_position_sensor_t& w) {
  if (!std::isfinite(w.eph)) return {};
  const auto known = [](float value) { return std::isfinite(value) ? std::optional<double>(value) : std::nullopt; };
  return GlobalPositionSensor{.target = {w.target_system, w.target_component},
                              .sensor_id = w.id,
                              .unix_us = static_cast<std::int64_t>(w.time_usec),
                              .processing_s = w.processing_time * 1e-6,
                              .place = {w.lon * 1e-7, w.lat * 1e-7},
                              .sigma_m = w.eph,
                              .msl_m = known(w.alt),
                              .vertical_sigma_m = known(w.epv)};
}

CompanionMessage read(const mavlink_command_long_t& w) {
  return CommandLong{.target = {w.target_system, w.target_component},
                     .command = w.command,
                     .confirmation = w.confirmation,
                     .parameters = {w.param1, w.param2, w.param3, w.param4, w.param5, w.param6, w.param7}};
}

CompanionMessage read(const mavlink_param_request_read_t& w) {
  return ParameterRequest{{w.target_system, w.target_component}, name_in(w.param_id)};
}

CompanionMessage read(const mavlink_param_set_t& w) {
  return ParameterSet{{w.target_system, w.target_component}, name_in(w.param_id), w.param_value, w.param_type};
}

template <class Wire>
CompanionMessage unpack_with(const mavlink_message_t& message, void (*unpack)(const mavlink_message_t*, Wire*)) {
  Wire wire{};
  unpack(&message, &wire);
  return read(wire);
}

}  // namespace

std::optional<Bytes> encode_from_autopilot(AutopilotType type, const IncomingMessage& message, MavlinkAddress from,
                                           std::uint8_t sequence) {
  return std::visit(AutopilotWriter(type, from, sequence), message);
}

std::optional<StreamRequest> stream_request(const CommandLong& command) {
  const auto id = clamped<std::uint32_t>(static_cast<double>(command.parameters[0]));
  if (command.command == MAV_CMD_SET_MESSAGE_INTERVAL)
    return StreamRequest{id, static_cast<double>(command.parameters[1]) * 1e-6};
  if (command.command == MAV_CMD_REQUEST_MESSAGE) return StreamRequest{id, std::nullopt};
  return std::nullopt;
}

CompanionMessage decode_from_companion(const MavlinkFrame& frame) {
  const mavlink_message_t message = wire_message(frame);
  switch (frame.message_id) {
    case MAVLINK_MSG_ID_GPS_INPUT: return unpack_with(message, mavlink_msg_gps_input_decode);
    case MAVLINK_MSG_ID_GLOBAL_POSITION_SENSOR: return unpack_with(message, mavlink_msg_global_position_sensor_decode);
    case MAVLINK_MSG_ID_COMMAND_LONG: return unpack_with(message, mavlink_msg_command_long_decode);
    case MAVLINK_MSG_ID_PARAM_REQUEST_READ: return unpack_with(message, mavlink_msg_param_request_read_decode);
    case MAVLINK_MSG_ID_PARAM_SET: return unpack_with(message, mavlink_msg_param_set_decode);
    default: return {};
  }
}

}  // namespace nadir
