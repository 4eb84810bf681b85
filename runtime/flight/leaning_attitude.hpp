// The autopilot's attitude leans on our fix, and our fix on its attitude. What the airframe's file claims of heading
// and tilt was measured with GPS; by fixes of a localizer that believes it, ArduPlane's attitude came off by 17 and 5
// degrees.
#pragma once

#include "vision/camera.hpp"

namespace nadir {

// Of an autopilot that flies by our fix, one sigma (docs/closed-loop.md): no claim is believed beyond them.
inline constexpr double kLeaningHeading_rad = 0.087;  // 5 degrees
inline constexpr double kLeaningTilt_rad = 0.035;     // 2 degrees

TelemetryUncertainty fix_aided_attitude(const TelemetryUncertainty& claimed);

}  // namespace nadir
