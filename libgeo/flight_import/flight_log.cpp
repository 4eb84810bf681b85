#include "flight_import/flight_log.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "base/quantile.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

constexpr double kDisorder_s = 1;           // samples of different sensors may be written this far out of order
constexpr double kMaxPause_s = 86'400;      // logging may be paused between two flights of one boot
constexpr int kNewTimeline = 20;            // samples in a row that agree on another time are no damage
constexpr double kMaxLogTime_s = 1e10;      // beyond any clock
constexpr double kMinTimeStep_s = 0.004;    // of one kind of sample: 250 Hz are more than photos need
constexpr double kMaxHeight_m = 30'000;     // above anything
constexpr double kLowestHeight_m = -1'000;  // below anything
constexpr double kTwoPi = 2 * 3.14159265358979323846;

template <class Sample>
auto first_not_before(const std::vector<Sample>& samples, double time_s) {
  return std::lower_bound(samples.begin(), samples.end(), time_s,
                          [](const Sample& sample, double at_s) { return sample.time_s < at_s; });
}

// The samples around a time and the share of the way between them; nothing in a gap.
template <class Sample>
struct Around {
  const Sample* before = nullptr;
  const Sample* after = nullptr;
  double share = 0;
};

template <class Sample>
std::optional<Around<Sample>> around(const std::vector<Sample>& samples, double time_s, double max_gap_s) {
  if (samples.empty()) return std::nullopt;
  const auto after = first_not_before(samples, time_s);
  if (after == samples.begin()) {
    if (after->time_s - time_s > max_gap_s) return std::nullopt;
    return Around<Sample>{&*after, &*after, 0};
  }
  const auto before = std::prev(after);
  if (after == samples.end()) {
    if (time_s - before->time_s > max_gap_s) return std::nullopt;
    return Around<Sample>{&*before, &*before, 0};
  }
  const double gap_s = after->time_s - before->time_s;
  if (gap_s > max_gap_s) return std::nullopt;
  return Around<Sample>{&*before, &*after, gap_s > 0 ? (time_s - before->time_s) / gap_s : 0};
}

template <class Sample>
bool in_order(const std::vector<Sample>& samples, double time_s) {
  return samples.empty() || time_s >= samples.back().time_s + kMinTimeStep_s;
}

double between(double from, double to, double share) { return from + share * (to - from); }
constexpr double kTimeRounding_s = 1e-6;

double angle_between(double from, double to, double share) { return wrap_pi(from + share * wrap_pi(to - from)); }

template <class Sample>
void widen(const std::vector<Sample>& samples, double& begin_s, double& end_s) {
  if (samples.empty()) return;
  begin_s = std::min(begin_s, samples.front().time_s);
  end_s = std::max(end_s, samples.back().time_s);
}

std::pair<double, double> span_of(const FlightLog& log) {
  double begin_s = std::numeric_limits<double>::infinity(), end_s = -begin_s;
  widen(log.attitudes, begin_s, end_s);
  for (const auto* heights : {&log.ranges, &log.terrain_heights, &log.home_heights, &log.msl_heights}) {
    widen(*heights, begin_s, end_s);
  }
  widen(log.positions, begin_s, end_s);
  widen(log.triggers, begin_s, end_s);
  return begin_s <= end_s ? std::pair(begin_s, end_s) : std::pair(0.0, 0.0);
}

}  // namespace

double FlightLog::begin_s() const { return span_of(*this).first; }
double FlightLog::end_s() const { return span_of(*this).second; }

std::optional<double> height_at(const std::vector<TimedHeight>& heights, double time_s, double max_gap_s) {
  const auto found = around(heights, time_s, max_gap_s);
  if (!found) return std::nullopt;
  return between(found->before->height_m, found->after->height_m, found->share);
}

std::optional<Attitude> attitude_at(const std::vector<TimedAttitude>& attitudes, double time_s, double max_gap_s) {
  const auto found = around(attitudes, time_s, max_gap_s);
  if (!found) return std::nullopt;
  const Attitude& a = found->before->aircraft;
  const Attitude& b = found->after->aircraft;
  return Attitude{angle_between(a.heading_rad, b.heading_rad, found->share),
                  angle_between(a.pitch_rad, b.pitch_rad, found->share),
                  angle_between(a.roll_rad, b.roll_rad, found->share)};
}

std::optional<TimedPosition> position_at(const std::vector<TimedPosition>& positions, double time_s, double max_gap_s) {
  const auto found = around(positions, time_s, max_gap_s);
  if (!found) return std::nullopt;
  const TimedPosition& a = *found->before;
  const TimedPosition& b = *found->after;
  const double lon_change_deg = std::remainder(b.place.lon_deg - a.place.lon_deg, 360.0);
  return TimedPosition{time_s,
                       {std::remainder(a.place.lon_deg + found->share * lon_change_deg, 360.0),
                        between(a.place.lat_deg, b.place.lat_deg, found->share)},
                       between(a.msl_m, b.msl_m, found->share)};
}

bool LogBuilder::take_time(double time_s) {
  if (log_.restarted) return false;
  const bool possible = std::isfinite(time_s) && time_s >= 0 && time_s < kMaxLogTime_s;
  if (possible && (!last_s_ || (time_s > *last_s_ - kDisorder_s && time_s < *last_s_ + kMaxPause_s))) {
    last_s_ = last_s_ ? std::max(*last_s_, time_s) : time_s;
    rejected_ = 0;
    return true;
  }
  ++log_.wrong_times;
  if (!possible) return false;
  const bool agrees = rejected_ > 0 && std::abs(time_s - rejected_s_) < kDisorder_s;
  rejected_ = agrees ? rejected_ + 1 : 1;
  rejected_s_ = time_s;
  if (rejected_ < kNewTimeline) return false;
  const bool nothing_yet = log_.records <= static_cast<std::uint64_t>(kNewTimeline) + 5;
  if (time_s > *last_s_ || nothing_yet) {  // the first times were wrong, or logging was paused for days
    last_s_ = time_s;
    rejected_ = 0;
    return true;
  }
  log_.restarted = true;
  return false;
}

void LogBuilder::attitude(double time_s, double heading_rad, double pitch_rad, double roll_rad) {
  const bool possible = std::abs(heading_rad) <= 2 * kTwoPi && std::abs(pitch_rad) <= kTwoPi / 4 + 1e-3 &&
                        std::abs(roll_rad) <= kTwoPi;  // false for NaN. ArduPilot lets roll run past 180 degrees
  if (!possible || !in_order(log_.attitudes, time_s)) return;
  log_.attitudes.push_back({time_s, {wrap_pi(heading_rad), pitch_rad, wrap_pi(roll_rad)}});
}

void LogBuilder::height(std::vector<TimedHeight> FlightLog::*which, double time_s, double height_m) {
  std::vector<TimedHeight>& heights = log_.*which;
  if (!(height_m > kLowestHeight_m && height_m < kMaxHeight_m) || !in_order(heights, time_s)) return;
  heights.push_back({time_s, height_m});
}

void LogBuilder::position(double time_s, LonLat place, double msl_m) {
  const bool possible = std::abs(place.lon_deg) <= 180 && std::abs(place.lat_deg) <= 90 && std::isfinite(msl_m) &&
                        !(place.lon_deg == 0 && place.lat_deg == 0);
  if (!possible || !in_order(log_.positions, time_s)) return;
  log_.positions.push_back({time_s, place, msl_m});
}

void LogBuilder::inertial(double time_s, const Eigen::Vector3d& rate_rad_s, const Eigen::Vector3d& force_mps2) {
  std::vector<InertialSample>& samples = log_.inertial;
  if (usable_samples(std::array{InertialSample{time_s, rate_rad_s, force_mps2}}, -1).empty()) return;
  if (time_s <= sum_.time_s) return;
  sum_.time_s = time_s;
  sum_.rate_rad_s += rate_rad_s;
  sum_.force_mps2 += force_mps2;
  ++summed_;
  if (!samples.empty() && time_s < samples.back().time_s + 1 / kInertialRate_hz - kTimeRounding_s) return;
  samples.push_back({time_s, sum_.rate_rad_s / summed_, sum_.force_mps2 / summed_});
  sum_ = {.time_s = time_s};
  summed_ = 0;
}

void LogBuilder::trigger(double time_s) {
  if (in_order(log_.triggers, time_s)) log_.triggers.push_back({time_s});
}

void LogBuilder::commanded_trigger(double time_s) {
  if (in_order(commanded_, time_s)) commanded_.push_back({time_s});
}

void LogBuilder::utc(double time_s, double unix_s) {
  constexpr double kYear2000_s = 946'684'800, kYear2100_s = 4'102'444'800;
  if (unix_s > kYear2000_s && unix_s < kYear2100_s) unix_from_log_s_.push_back(unix_s - time_s);
}

FlightLog LogBuilder::finish() {
  if (!unix_from_log_s_.empty()) {
    log_.unix_from_log_s = median(std::move(unix_from_log_s_));
    if (log_.utc_from.empty()) log_.utc_from = "GPS";
  }
  if (log_.triggers.empty()) log_.triggers = std::move(commanded_);
  return std::move(log_);
}

}  // namespace nadir
