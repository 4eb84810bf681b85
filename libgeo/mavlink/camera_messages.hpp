// Messages about pictures: what an autopilot or a camera says when one was taken. Only logs are read for them; the
// service in flight has its own camera.
#pragma once

#include <cstdint>
#include <optional>

#include "mavlink/frame.hpp"

namespace nadir {

// CAMERA_FEEDBACK and CAMERA_IMAGE_CAPTURED: a picture was taken. CAMERA_TRIGGER: the camera was triggered.
struct PictureReport {
  enum class Kind { feedback, captured, triggered };

  Kind kind = Kind::feedback;
  std::optional<double> unix_s;  // when, by the sender's clock; of the two the sender states at least one, or neither
  std::optional<double> boot_s;
};

// nullopt: another message, or the report of a failure.
std::optional<PictureReport> decode_picture_report(const MavlinkFrame& frame);

}  // namespace nadir
