#include <ardupilotmega/mavlink.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "geodesy/angles.hpp"
#include "mavlink/codec.hpp"

namespace nadir {
namespace {

// A number as a field holds it: rounded, the nearest end when it is out of range, zero for NaN.
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

// 0 means that there is none, so that north is 36000.
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
    w.speed_accuracy = given(m.speed_accuracy_m_s, GPS_INPUT_IGNORE_FLAG_SPEED_ACCURACY);
    if (!m.velocity) ignore |= GPS_INPUT_IGNORE_FLAG_VEL_HORIZ;
    const GpsVelocity velocity = m.velocity.value_or(GpsVelocity{});
    w.vn = static_cast<float>(velocity.north_m_s);
    w.ve = static_cast<float>(velocity.east_m_s);
    w.vd = given(velocity.down_m_s, GPS_INPUT_IGNORE_FLAG_VEL_VERT);
    w.ignore_flags = static_cast<std::uint16_t>(ignore);
    w.satellites_visible = rounded<std::uint8_t>(m.satellites);
    w.yaw = yaw_cdeg(m.yaw_rad);
    return pack(mavlink_msg_gps_input_encode_status, w);
  }

  Bytes operator()(const Timesync& m) {
    mavlink_timesync_t w{};
    w.tc1 = m.answered_ns;
    w.ts1 = m.sent_ns;
    return pack(mavlink_msg_timesync_encode_status, w);
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

  Bytes operator()(const ParameterListRequest& m) {
    mavlink_param_request_list_t w{};
    w.target_system = m.target.system;
    w.target_component = m.target.component;
    return pack(mavlink_msg_param_request_list_encode_status, w);
  }

  Bytes operator()(const ParameterSet& m) {
    mavlink_param_set_t w{};
    w.target_system = m.target.system;
    w.target_component = m.target.component;
    put_text(w.param_id, m.name);
    w.param_value = m.value;
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

Bytes encode(const OutgoingMessage& message, MavlinkAddress from, std::uint8_t sequence) {
  return std::visit(Writer(from, sequence), message);
}

void mark_signed(Bytes& frame) {
  frame[2] |= MAVLINK_IFLAG_SIGNED;
  const std::uint32_t id = frame[7] | (std::uint32_t{frame[8]} << 8) | (std::uint32_t{frame[9]} << 16);
  const std::size_t end = frame.size() - MAVLINK_NUM_CHECKSUM_BYTES;
  std::uint16_t crc = crc_calculate(frame.data() + 1, static_cast<std::uint16_t>(end - 1));
  crc_accumulate(mavlink_get_msg_entry(id)->crc_extra, &crc);
  frame[end] = static_cast<std::uint8_t>(crc & 0xFF);
  frame[end + 1] = static_cast<std::uint8_t>(crc >> 8);
}

}  // namespace nadir
