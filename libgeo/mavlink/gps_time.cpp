#include "mavlink/gps_time.hpp"

#include <algorithm>
#include <array>
#include <iterator>

namespace nadir {
namespace {

constexpr std::int64_t kGpsEpochUnixS = 315'964'800;  // 1980-01-06T00:00:00Z
constexpr std::int64_t kWeekMs = 7 * 86'400'000LL;

// Unix time from which one second more counts (IERS Bulletin C). The last one is that of 2017-01-01; the tests compare
// with the system's list, which learns of new ones.
constexpr std::array<std::int64_t, 18> kLeapsUnixS{
    362793600, 394329600, 425865600, 489024000, 567993600,  631152000,  662688000,  709948800,  741484800,
    773020800, 820454400, 867715200, 915148800, 1136073600, 1230768000, 1341100800, 1435708800, 1483228800};

}  // namespace

int leap_seconds(std::int64_t unix_s) {
  return static_cast<int>(
      std::distance(kLeapsUnixS.begin(), std::upper_bound(kLeapsUnixS.begin(), kLeapsUnixS.end(), unix_s)));
}

GpsTime gps_time(std::int64_t unix_us) {
  const std::int64_t unix_s = unix_us / 1'000'000;
  if (unix_s < kGpsEpochUnixS) return {};
  const std::int64_t gps_ms = unix_us / 1000 - kGpsEpochUnixS * 1000 + leap_seconds(unix_s) * 1000LL;
  return {static_cast<std::uint16_t>(gps_ms / kWeekMs), static_cast<std::uint32_t>(gps_ms % kWeekMs)};
}

}  // namespace nadir
