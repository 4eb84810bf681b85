// What only a try shows: that the autopilot sends its accelerometer often enough, and hears our GPS_INPUT.
#pragma once

#include "provision/autopilot_session.hpp"

namespace nadir {

inline constexpr double kWantedImuRate_hz = 40;  // the most that ArduPlane sends as it comes
inline constexpr double kLeastImuRate_hz = 30;

// Asks for RAW_IMU and measures its rate by the autopilot's own clock, again while it is slow: an autopilot that has
// just been started takes its time. Throws Error below kLeastImuRate_hz.
double check_imu_rate(AutopilotSession& session, MavlinkAddress autopilot);

// Sends a place where nobody flies, with an accuracy that no check of the autopilot passes, until its receiver tells
// that place, and then "no fix". Throws Error when it does not. receiver: 1 or 2, the one that GPS_INPUT plays.
void check_gps_input(AutopilotSession& session, MavlinkAddress autopilot, int receiver);

}  // namespace nadir
