// How the telemetry is believed to err: shares of the sigma that the camera file states, and how long an error lasts.
#pragma once

namespace nadir::telemetry_model {

inline constexpr double kUnknownHeadingVariance = 4.0;  // rad²: about 115 degrees, any heading

// Heading: what stays, what turns with the course, and what changes from frame to frame.
inline constexpr double kConstantHeading = 0.8, kDeviation = 0.6, kChangingHeading = 0.5;
// In which the deviation is forgotten: an autopilot's filter leans on more than a compass.
inline constexpr double kDeviationTime_s = 90;

inline constexpr double kHeightWander = 0.25;  // per frame: barometer noise, ground that rolls by

// Tilt: what changes from frame to frame; the whole sigma stays for a while.
inline constexpr double kChangingTiltLogged = 0.7, kChangingTiltUnlogged = 0.3;
inline constexpr double kTiltTimeLogged_s = 240;      // attitude from an AHRS …
inline constexpr double kTiltTimeUnlogged_s = 12000;  // … or a mount or a gimbal
// Of the tilt's sigma: what tilts the accelerometer as well, and is not the mount's or the moment's.
inline constexpr double kLevel = 0.3;

}  // namespace nadir::telemetry_model
