#include "mavlink/camera_messages.hpp"

#include <ardupilotmega/mavlink.h>

#include <algorithm>

namespace nadir {
namespace {

// Without a checksum test: the frame's reader has made it. By decode(), because the generated getters of single fields
// read them where they lie, aligned or not.
template <class Wire>
Wire wire_of(const MavlinkFrame& frame, void (*decode)(const mavlink_message_t*, Wire*)) {
  mavlink_message_t working{}, message{};
  mavlink_status_t status{};
  for (const std::uint8_t byte : frame.bytes) {
    mavlink_frame_char_buffer(&working, &status, byte, &message, nullptr);
  }
  Wire wire{};
  decode(&message, &wire);
  return wire;
}

// Microseconds since 1970 or since boot, distinguished by their magnitude as MAVLink prescribes.
void set_time(PictureReport& report, std::uint64_t us) {
  constexpr std::uint64_t kYear2000_us = 946'684'800'000'000, kYear2100_us = 4'102'444'800'000'000;
  if (us == 0 || us > kYear2100_us) return;
  (us > kYear2000_us ? report.unix_s : report.boot_s) = static_cast<double>(us) * 1e-6;
}

}  // namespace

std::optional<PictureReport> decode_picture_report(const MavlinkFrame& frame) {
  PictureReport report;
  if (frame.message_id == MAVLINK_MSG_ID_CAMERA_FEEDBACK) {
    report.kind = PictureReport::Kind::feedback;
    set_time(report, wire_of(frame, mavlink_msg_camera_feedback_decode).time_usec);
    return report;
  }
  if (frame.message_id == MAVLINK_MSG_ID_CAMERA_IMAGE_CAPTURED) {
    const auto captured = wire_of(frame, mavlink_msg_camera_image_captured_decode);
    if (captured.capture_result != 1) return std::nullopt;
    report.kind = PictureReport::Kind::captured;
    set_time(report, captured.time_utc);
    if (captured.time_boot_ms != 0) report.boot_s = captured.time_boot_ms * 1e-3;
    return report;
  }
  if (frame.message_id == MAVLINK_MSG_ID_CAMERA_TRIGGER) {
    report.kind = PictureReport::Kind::triggered;
    set_time(report, wire_of(frame, mavlink_msg_camera_trigger_decode).time_usec);
    return report;
  }
  return std::nullopt;
}

}  // namespace nadir
