// GPS_INPUT as ArduPilot expects it (AP_GPS_MAV and the EKF's GPS checks; docs/autopilot.md has the rules and their
// reasons), and GPS time.
#pragma once

#include <cstdint>
#include <optional>

#include "geodesy/lon_lat.hpp"
#include "mavlink/messages.hpp"

namespace nadir {

struct GpsTime {
  std::uint16_t week = 0;  // since 1980-01-06, not rolled over
  std::uint32_t week_ms = 0;
};

// GPS time minus UTC at that moment.
int leap_seconds(std::int64_t unix_s);

// Zero before the GPS epoch. Off by one second during a leap second, which Unix time cannot express.
GpsTime gps_time(std::int64_t unix_us);

// A position with a larger sigma is not usable.
inline constexpr double kMaxFixSigma_m = 500.0;

// A position to send, valid at unix_us.
struct Fix {
  std::int64_t unix_us = 0;
  LonLat place{};
  double sigma_m = 0;  // horizontal, one axis
  std::optional<double> msl_m{};
  std::optional<double> vertical_sigma_m{};
  std::optional<GpsVelocity> velocity{};
  std::optional<double> speed_sigma_mps{};
  std::optional<double> yaw_rad{};
};

// A fix with NaN or infinity, or a sigma beyond kMaxFixSigma_m, becomes "no fix".
GpsInput gps_input(const Fix& fix, std::uint8_t gps_id = 0);

// fix_type 0, horiz_accuracy 999: the receiver is alive but has no fix.
GpsInput gps_input_without_fix(std::int64_t unix_us, std::uint8_t gps_id = 0);

}  // namespace nadir
