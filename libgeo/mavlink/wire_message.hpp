// A frame as MAVLink's generated decoders take it. For the sources of this folder: the generated headers are large.
#pragma once

#include <ardupilotmega/mavlink.h>

#include <cstring>

#include "mavlink/frame.hpp"

namespace nadir {

inline mavlink_message_t wire_message(const MavlinkFrame& frame) {
  mavlink_message_t message{};
  message.msgid = frame.message_id & 0xFFFFFFU;
  message.len = frame.bytes[1];
  const std::size_t header = frame.version == 2 ? MAVLINK_NUM_HEADER_BYTES : MAVLINK_CORE_HEADER_MAVLINK1_LEN + 1;
  std::memcpy(message.payload64, frame.bytes.data() + header, message.len);
  return message;
}

}  // namespace nadir
