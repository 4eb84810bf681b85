// GPS_INPUT as ArduPilot wants it (AP_GPS_MAV, the EKF's GPS checks): docs/autopilot.md has the rules and their
// reasons.
#pragma once

#include <cstdint>
#include <optional>

#include "geodesy/lon_lat.hpp"
#include "mavlink/messages.hpp"

namespace nadir {

// Above this a position is none.
inline constexpr double kMaxFixSigmaM = 500.0;

// A position of ours, at the moment when it is sent.
struct Fix {
  std::int64_t unix_us = 0;
  LonLat place{};
  double sigma_m = 0;  // horizontal, one axis
  std::optional<double> msl_m{};
  std::optional<double> vertical_sigma_m{};
  std::optional<GpsVelocity> velocity{};
  std::optional<double> speed_sigma_m_s{};
  std::optional<double> yaw_rad{};
};

// A fix whose numbers are none, or whose sigma is beyond kMaxFixSigmaM, becomes "no fix".
GpsInput gps_input(const Fix& fix, std::uint8_t gps_id = 0);

// fix_type 0, horiz_accuracy 999: still heard, not to be used.
GpsInput gps_input_without_fix(std::int64_t unix_us, std::uint8_t gps_id = 0);

}  // namespace nadir
