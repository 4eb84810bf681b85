// GPS weeks and milliseconds, and the one place that knows of leap seconds.
#pragma once

#include <cstdint>

namespace nadir {

struct GpsTime {
  std::uint16_t week = 0;  // since 1980-01-06, not rolled over
  std::uint32_t week_ms = 0;
};

// GPS time is ahead of UTC by this many seconds at that moment.
int leap_seconds(std::int64_t unix_s);

// Zero before GPS began. During a leap second itself, which UTC in Unix form cannot name, it is off by that second.
GpsTime gps_time(std::int64_t unix_us);

}  // namespace nadir
