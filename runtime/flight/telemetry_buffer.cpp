#include "flight/telemetry_buffer.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "geodesy/angles.hpp"

namespace nadir {
namespace {

// Appends to a queue that is ordered by time_s and bounded in time. Items older than the last one are dropped.
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

double interpolate(double a, double b, double t) { return a + t * (b - a); }
double interpolate_angle(double a, double b, double t) { return wrap_pi(a + t * wrap_pi(b - a)); }

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

void TelemetryBuffer::on_message(double time_s, const AircraftAttitude& attitude) {
  const Vector3& rate = attitude.rate_rad_s;
  keep(attitudes_,
       TimedAttitude{time_s, {attitude.yaw_rad, attitude.pitch_rad, attitude.roll_rad}, {rate.x, rate.y, rate.z}});
}

void TelemetryBuffer::on_message(double time_s, const GimbalAttitude& gimbal) {
  if (gimbal.faulty) return;
  const auto& q = gimbal.level_from_gimbal;
  keep(gimbals_, TimedGimbal{time_s, Eigen::Quaterniond(q[0], q[1], q[2], q[3]), gimbal.from_north});
}

void TelemetryBuffer::on_message(double time_s, const GlobalPosition& position) {
  keep(home_heights_, Height{time_s, position.above_home_m});
  keep(msl_heights_, Height{time_s, position.msl_m});
}

void TelemetryBuffer::on_message(double time_s, const GroundDistance& distance) {
  if (!(distance.distance_m > distance.min_m && distance.distance_m < distance.max_m)) return;
  const Attitude aircraft = aircraft_at(time_s).value_or(Attitude{});  // it points along the aircraft's vertical axis
  keep(ranges_, Height{time_s, distance.distance_m * std::cos(aircraft.pitch_rad) * std::cos(aircraft.roll_rad)});
}

void TelemetryBuffer::on_message(double time_s, const GroundHeight& height) {
  keep(terrain_heights_, Height{time_s, height.above_terrain_m});
}

// Specific force, levelled with the attitude of that moment: its horizontal part is the horizontal acceleration.
void TelemetryBuffer::on_message(double time_s, const ImuSample& sample) {
  if (sample.instance != 1) return;
  if (const auto stamped = needs_.gimbal ? std::nullopt : stamped_s(time_s, sample.time_us)) {
    const Vector3 &rate = sample.rate_rad_s, &pull = sample.acceleration_mps2;
    keep(inertial_, InertialSample{*stamped, camera_rate({rate.x, rate.y, rate.z}, mount_),
                                   camera_rate({pull.x, pull.y, pull.z}, mount_)});
  }
  const auto aircraft = aircraft_at(time_s);
  if (!aircraft) return;
  const Eigen::Vector3d force(sample.acceleration_mps2.x, sample.acceleration_mps2.y, sample.acceleration_mps2.z);
  const Eigen::Vector3d ned = Eigen::AngleAxisd(aircraft->heading_rad, Eigen::Vector3d::UnitZ()) *
                              (Eigen::AngleAxisd(aircraft->pitch_rad, Eigen::Vector3d::UnitY()) *
                               (Eigen::AngleAxisd(aircraft->roll_rad, Eigen::Vector3d::UnitX()) * force));
  if (ned.allFinite()) keep(accelerations_, TimedAcceleration{time_s, {ned.y(), ned.x()}});
}

void TelemetryBuffer::on_message(double time_s, const GpsRaw& fix) {
  if (fix.fix >= GpsFix::three_d) keep(places_, TimedPlace{time_s, fix.place});
}

// Nothing of a sample that has no stamp.
std::optional<double> TelemetryBuffer::stamped_s(double arrival_s, std::uint64_t stamp_us) {
  if (stamp_us == 0) return std::nullopt;
  const double stamp_s = static_cast<double>(stamp_us) * 1e-6, delay_s = arrival_s - stamp_s;
  const double drifted_s = kClockDrift * std::max(0.0, arrival_s - imu_arrival_s_);
  imu_arrival_s_ = arrival_s;
  if (!imu_delay_s_ ||
      std::abs(delay_s - *imu_delay_s_) > kMaxImuDelay_s) {  // the first one, or the autopilot restarted
    imu_delay_s_ = delay_s;
    inertial_.clear();
  }
  imu_delay_s_ = std::min(delay_s, *imu_delay_s_ + drifted_s);
  return stamp_s + *imu_delay_s_;
}

// After the one moment and up to the other.
std::vector<InertialSample> TelemetryBuffer::inertial_between(double from_s, double to_s) const {
  const auto from = std::ranges::upper_bound(inertial_, from_s, {}, &InertialSample::time_s);
  const auto to = std::ranges::upper_bound(inertial_, to_s, {}, &InertialSample::time_s);
  return {from, std::max(from, to)};
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
  const TimedAttitude& before = *std::prev(after);
  const double gap_s = after->time_s - before.time_s;
  if (gap_s > kAttitudeGap_s) return std::nullopt;
  const double t = (time_s - before.time_s) / gap_s;
  return Attitude{interpolate_angle(before.aircraft.heading_rad, after->aircraft.heading_rad, t),
                  interpolate(before.aircraft.pitch_rad, after->aircraft.pitch_rad, t),
                  interpolate_angle(before.aircraft.roll_rad, after->aircraft.roll_rad, t)};
}

// Linear between two fixes; none before the first and after the last.
std::optional<LonLat> TelemetryBuffer::place_at(double time_s) const {
  const auto after = at_or_after(places_, time_s);
  if (after == places_.end()) return std::nullopt;
  if (after->time_s == time_s) return after->place;
  if (after == places_.begin()) return std::nullopt;
  const TimedPlace& before = *std::prev(after);
  if (after->time_s - before.time_s > kPlaceGap_s) return std::nullopt;
  const double t = (time_s - before.time_s) / (after->time_s - before.time_s);
  const double lon_change_deg = std::remainder(after->place.lon_deg - before.place.lon_deg, 360.0);
  return LonLat{std::remainder(before.place.lon_deg + t * lon_change_deg, 360.0),
                interpolate(before.place.lat_deg, after->place.lat_deg, t)};
}

// Each sample holds since the one before. nullopt when there is a gap.
std::optional<Eigen::Vector2d> TelemetryBuffer::velocity_change(double from_s, double to_s) const {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  double done_s = from_s;
  for (auto sample = at_or_after(accelerations_, from_s); done_s < to_s; ++sample) {
    if (sample == accelerations_.end()) {  // the last sample holds a little longer
      if (accelerations_.empty() || to_s - accelerations_.back().time_s > kImuGap_s) return std::nullopt;
      return sum + (to_s - done_s) * accelerations_.back().east_north_mps2;
    }
    if (sample->time_s - done_s > kImuGap_s) return std::nullopt;
    const double until_s = std::min(sample->time_s, to_s);
    sum += (until_s - done_s) * sample->east_north_mps2;
    done_s = until_s;
  }
  return sum;
}

// Its yaw from the aircraft's heading goes with the heading of the same moment.
std::optional<Attitude> TelemetryBuffer::camera_on_gimbal_at(double time_s) const {
  const auto after = at_or_after(gimbals_, time_s);
  std::optional<TimedGimbal> now;
  if (after == gimbals_.end()) {
    if (gimbals_.empty() || time_s - gimbals_.back().time_s > kGimbalHeld_s) return std::nullopt;
    now = gimbals_.back();
  } else if (after->time_s == time_s) {
    now = *after;
  } else {
    if (after == gimbals_.begin()) return std::nullopt;
    const TimedGimbal& before = *std::prev(after);
    const double gap_s = after->time_s - before.time_s;
    if (gap_s > kGimbalGap_s || before.from_north != after->from_north) return std::nullopt;
    now = *after;
    now->level_from_gimbal = before.level_from_gimbal.slerp((time_s - before.time_s) / gap_s, after->level_from_gimbal);
  }
  Eigen::Matrix3d ned_from_gimbal = now->level_from_gimbal.toRotationMatrix();
  if (!now->from_north) {
    const auto aircraft = aircraft_at(time_s);
    if (!aircraft) return std::nullopt;
    ned_from_gimbal = Eigen::AngleAxisd(aircraft->heading_rad, Eigen::Vector3d::UnitZ()) * ned_from_gimbal;
  }
  return camera_attitude_on_gimbal(ned_from_gimbal, mount_);
}

std::optional<Eigen::Vector3d> TelemetryBuffer::camera_rate_at(double time_s) const {
  if (needs_.gimbal) {
    const auto before = camera_at(time_s - kRateStep_s), after = camera_at(time_s + kRateStep_s);
    if (!before || !after) return std::nullopt;
    return camera_rate(*before, *after, 2 * kRateStep_s);
  }
  const auto after = at_or_after(attitudes_, time_s);
  if (!aircraft_at(time_s)) return std::nullopt;
  if (after == attitudes_.end()) return camera_rate(attitudes_.back().rate_rad_s, mount_);
  if (after == attitudes_.begin()) return camera_rate(after->rate_rad_s, mount_);
  const TimedAttitude& before = *std::prev(after);
  const double t = (time_s - before.time_s) / (after->time_s - before.time_s);
  return camera_rate(before.rate_rad_s + t * (after->rate_rad_s - before.rate_rad_s), mount_);
}

std::optional<Attitude> TelemetryBuffer::camera_at(double time_s) const {
  if (needs_.gimbal) return camera_on_gimbal_at(time_s);
  const auto aircraft = aircraft_at(time_s);
  if (!aircraft) return std::nullopt;
  return camera_attitude(*aircraft, mount_);
}

// All intervals but the last. Of the time before the buffer begins, only its length is known.
std::vector<TelemetryInterval> TelemetryBuffer::path(double from_s, double to_s) const {
  std::vector<TelemetryInterval> path;
  const double kept_from_s = std::max(from_s, to_s - kTelemetryKept_s);
  const int intervals = static_cast<int>(std::ceil((to_s - kept_from_s) / kMaxTelemetryInterval_s));
  double begin_s = from_s;
  for (int i = kept_from_s > from_s ? 0 : 1; i < intervals; ++i) {
    const double end_s = interpolate(kept_from_s, to_s, static_cast<double>(i) / intervals);
    TelemetryInterval interval{end_s - begin_s, std::nullopt, velocity_change(begin_s, end_s)};
    const auto camera = camera_at(end_s);
    if (camera && (!needs_.gimbal || interval.imu_dv_mps)) interval.heading_rad = camera->heading_rad;
    path.push_back(interval);
    begin_s = end_s;
  }
  return path;
}

Telemetry TelemetryBuffer::at(double time_s) {
  Telemetry telemetry;
  telemetry.time_s = time_s;
  if (const auto camera = camera_at(time_s)) {
    telemetry.heading_rad = camera->heading_rad;
    telemetry.pitch_rad = camera->pitch_rad;
    telemetry.roll_rad = camera->roll_rad;
  }
  telemetry.agl_m = nearest(ranges_, time_s);
  if (!telemetry.agl_m) telemetry.agl_m = nearest(terrain_heights_, time_s);
  if (last_time_s_ && *last_time_s_ < time_s) {
    telemetry.intervals = path(*last_time_s_, time_s);
    double from_s = *last_time_s_;
    for (const TelemetryInterval& interval : telemetry.intervals) from_s += interval.seconds;
    telemetry.imu_dv_mps = velocity_change(from_s, time_s);
    if (needs_.gimbal && !telemetry.imu_dv_mps) telemetry.heading_rad.reset();
    if (needs_.inertial) telemetry.inertial = inertial_between(*last_time_s_, time_s);
  }
  if (needs_.turn_rate) telemetry.rate_rad_s = camera_rate_at(time_s);
  last_time_s_ = time_s;
  telemetry.gps_position = place_at(time_s);
  return telemetry;
}

}  // namespace nadir
