#include "flight/telemetry_buffer.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "geodesy/angles.hpp"

namespace nadir {
namespace {

// Keeps a queue of things with time_s in order and short. What comes with an older time than the last one is left out.
template <typename T>
bool keep(std::deque<T>& queue, const T& item) {
  if (!std::isfinite(item.time_s) || (!queue.empty() && item.time_s < queue.back().time_s)) return false;
  queue.push_back(item);
  while (queue.front().time_s < item.time_s - kTelemetryKept_s) queue.pop_front();
  return true;
}

// The first at or after that time.
template <typename T>
auto at_or_after(const std::deque<T>& queue, double time_s) {
  return std::ranges::lower_bound(queue, time_s, {}, &T::time_s);
}

double between(double a, double b, double share) { return a + share * (b - a); }
double between_angles(double a, double b, double share) { return wrap_pi(a + share * wrap_pi(b - a)); }

// The nearest value in time, if near enough.
template <typename T>
std::optional<double> nearest(const std::deque<T>& queue, double time_s) {
  std::optional<double> value;
  double least_s = kHeightGap_s;
  for (const T& item : queue) {
    const double off_s = std::abs(item.time_s - time_s);
    if (off_s > least_s) continue;
    least_s = off_s;
    value = item.value_m;
  }
  return value;
}

}  // namespace

void TelemetryBuffer::hear(double time_s, const AircraftAttitude& attitude) {
  keep(attitudes_, HeldAttitude{time_s, {attitude.yaw_rad, attitude.pitch_rad, attitude.roll_rad}});
}

void TelemetryBuffer::hear(double time_s, const GlobalPosition& position) {
  keep(home_heights_, Height{time_s, position.above_home_m});
  keep(msl_heights_, Height{time_s, position.msl_m});
}

void TelemetryBuffer::hear(double time_s, const GroundDistance& distance) {
  if (!(distance.distance_m > distance.min_m && distance.distance_m < distance.max_m)) return;
  const Attitude aircraft = aircraft_at(time_s).value_or(Attitude{});  // it looks along the aircraft's own axis
  keep(ranges_, Height{time_s, distance.distance_m * std::cos(aircraft.pitch_rad) * std::cos(aircraft.roll_rad)});
}

void TelemetryBuffer::hear(double time_s, const GroundHeight& height) {
  keep(terrain_heights_, Height{time_s, height.above_terrain_m});
}

// Specific force, turned level by the attitude of that moment: its horizontal part is the horizontal acceleration.
void TelemetryBuffer::hear(double time_s, const ImuSample& sample) {
  if (sample.instance != 1) return;
  const auto aircraft = aircraft_at(time_s);
  if (!aircraft) return;
  const Eigen::Vector3d force(sample.acceleration_m_s2.x, sample.acceleration_m_s2.y, sample.acceleration_m_s2.z);
  const Eigen::Vector3d ned = Eigen::AngleAxisd(aircraft->heading_rad, Eigen::Vector3d::UnitZ()) *
                              (Eigen::AngleAxisd(aircraft->pitch_rad, Eigen::Vector3d::UnitY()) *
                               (Eigen::AngleAxisd(aircraft->roll_rad, Eigen::Vector3d::UnitX()) * force));
  if (ned.allFinite()) keep(pushes_, Push{time_s, {ned.y(), ned.x()}});
}

void TelemetryBuffer::hear(double time_s, const GpsRaw& fix) {
  if (fix.fix >= GpsFix::three_d) keep(places_, Place{time_s, fix.place});
}

std::optional<double> TelemetryBuffer::attitude_age_s(double now_s) const {
  if (attitudes_.empty()) return std::nullopt;
  return now_s - attitudes_.back().time_s;
}

std::optional<double> TelemetryBuffer::above_home_m(double time_s) const { return nearest(home_heights_, time_s); }
std::optional<double> TelemetryBuffer::msl_m(double time_s) const { return nearest(msl_heights_, time_s); }

std::optional<Attitude> TelemetryBuffer::aircraft_at(double time_s) const {
  const auto after = at_or_after(attitudes_, time_s);
  if (after == attitudes_.end()) {
    if (attitudes_.empty() || time_s - attitudes_.back().time_s > kAttitudeGap_s) return std::nullopt;
    return attitudes_.back().aircraft;
  }
  if (after->time_s == time_s) return after->aircraft;
  if (after == attitudes_.begin()) return std::nullopt;
  const HeldAttitude& before = *std::prev(after);
  const double gap_s = after->time_s - before.time_s;
  if (gap_s > kAttitudeGap_s) return std::nullopt;
  const double share = (time_s - before.time_s) / gap_s;
  return Attitude{between_angles(before.aircraft.heading_rad, after->aircraft.heading_rad, share),
                  between(before.aircraft.pitch_rad, after->aircraft.pitch_rad, share),
                  between_angles(before.aircraft.roll_rad, after->aircraft.roll_rad, share)};
}

// On the line between two fixes; nothing before the first and after the last.
std::optional<LonLat> TelemetryBuffer::place_at(double time_s) const {
  const auto after = at_or_after(places_, time_s);
  if (after == places_.end()) return std::nullopt;
  if (after->time_s == time_s) return after->at;
  if (after == places_.begin()) return std::nullopt;
  const Place& before = *std::prev(after);
  if (after->time_s - before.time_s > kPlaceGap_s) return std::nullopt;
  const double share = (time_s - before.time_s) / (after->time_s - before.time_s);
  const double lon_change_deg = std::remainder(after->at.lon_deg - before.at.lon_deg, 360.0);
  return LonLat{std::remainder(before.at.lon_deg + share * lon_change_deg, 360.0),
                between(before.at.lat_deg, after->at.lat_deg, share)};
}

// Each sample stands for the time since the one before. Nothing when any stretch has none.
std::optional<Eigen::Vector2d> TelemetryBuffer::velocity_change(double from_s, double to_s) const {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  double done_s = from_s;
  for (auto push = at_or_after(pushes_, from_s); done_s < to_s; ++push) {
    if (push == pushes_.end()) {  // the last one still holds for a moment
      if (pushes_.empty() || to_s - pushes_.back().time_s > kImuGap_s) return std::nullopt;
      return sum + (to_s - done_s) * pushes_.back().east_north_mps2;
    }
    if (push->time_s - done_s > kImuGap_s) return std::nullopt;
    const double until_s = std::min(push->time_s, to_s);
    sum += (until_s - done_s) * push->east_north_mps2;
    done_s = until_s;
  }
  return sum;
}

std::optional<Attitude> TelemetryBuffer::camera_at(double time_s) const {
  const auto aircraft = aircraft_at(time_s);
  if (!aircraft) return std::nullopt;
  return camera_attitude(*aircraft, mount_);
}

// All stretches but the last. Of what lies before all that is kept, nothing is told but how long it was.
std::vector<TelemetryInterval> TelemetryBuffer::way(double from_s, double to_s) const {
  std::vector<TelemetryInterval> way;
  const double kept_from_s = std::max(from_s, to_s - kTelemetryKept_s);
  const int stretches = static_cast<int>(std::ceil((to_s - kept_from_s) / kLongestStretch_s));
  double begin_s = from_s;
  for (int i = kept_from_s > from_s ? 0 : 1; i < stretches; ++i) {
    const double end_s = between(kept_from_s, to_s, static_cast<double>(i) / stretches);
    TelemetryInterval stretch{end_s - begin_s, std::nullopt, velocity_change(begin_s, end_s)};
    if (const auto camera = camera_at(end_s)) stretch.heading_rad = camera->heading_rad;
    way.push_back(stretch);
    begin_s = end_s;
  }
  return way;
}

Telemetry TelemetryBuffer::at(double time_s) {
  Telemetry told;
  told.time_s = time_s;
  if (const auto camera = camera_at(time_s)) {
    told.heading_rad = camera->heading_rad;
    told.pitch_rad = camera->pitch_rad;
    told.roll_rad = camera->roll_rad;
  }
  told.agl_m = nearest(ranges_, time_s);
  if (!told.agl_m) told.agl_m = nearest(terrain_heights_, time_s);
  if (last_asked_s_ && *last_asked_s_ < time_s) {
    told.intervals = way(*last_asked_s_, time_s);
    double from_s = *last_asked_s_;
    for (const TelemetryInterval& stretch : told.intervals) from_s += stretch.seconds;
    told.imu_dv_mps = velocity_change(from_s, time_s);
  }
  last_asked_s_ = time_s;
  told.place = place_at(time_s);
  return told;
}

}  // namespace nadir
