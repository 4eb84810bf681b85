#include "simulation/flight_path.hpp"

#include <algorithm>
#include <cmath>

#include "base/random.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/gravity.hpp"
#include "simulation/noise.hpp"

namespace nadir {
namespace {

constexpr double kUsualBank_rad = 0.38;  // 22 degrees

// The route as points about a metre apart, corners replaced by arcs.
PlanePath rounded(const PlanePath& route, double radius_m, double step_m) {
  PlanePath corners;
  for (const PlanePoint p : route) {
    if (corners.empty() || (p - corners.back()).norm() > 0.01) corners.push_back(p);
  }
  PlanePath line;
  const auto straight = [&](PlanePoint to) {
    if (line.empty()) {
      line.push_back(to);
      return;
    }
    const PlanePoint from = line.back();
    const int steps = std::max(1, static_cast<int>((to - from).norm() / step_m));
    for (int i = 1; i <= steps; ++i) line.push_back(from + (to - from) * (static_cast<double>(i) / steps));
  };
  if (!corners.empty()) straight(corners.front());
  for (std::size_t i = 1; i + 1 < corners.size(); ++i) {
    const Eigen::Vector2d in = corners[i] - corners[i - 1], out = corners[i + 1] - corners[i];
    const Eigen::Vector2d a = in.normalized(), b = out.normalized();
    const double turn = std::atan2(a.x() * b.y() - a.y() * b.x(), a.dot(b));
    const double half = std::tan(std::min(std::abs(turn) / 2, 1.5));
    if (half < 1e-6) {
      straight(corners[i]);
      continue;
    }
    const double room = 0.49 * std::min(in.norm(), out.norm());
    const double tangent = std::min(radius_m * half, room), radius = tangent / half;
    const PlanePoint start = corners[i] - a * tangent;
    straight(start);
    const double side = turn > 0 ? 1 : -1;
    const PlanePoint centre = start + Eigen::Vector2d(-a.y(), a.x()) * (side * radius);
    const int steps = std::max(2, static_cast<int>(std::abs(turn) * radius / step_m));
    for (int k = 1; k <= steps; ++k) {
      const double angle = turn * k / steps;
      const Eigen::Vector2d arm = start - centre;
      line.push_back(centre + Eigen::Vector2d(arm.x() * std::cos(angle) - arm.y() * std::sin(angle),
                                              arm.x() * std::sin(angle) + arm.y() * std::cos(angle)));
    }
  }
  if (corners.size() > 1) straight(corners.back());
  return line;
}

// Mean of `values` over ± reach entries.
std::vector<double> smoothed(const std::vector<double>& values, int reach) {
  std::vector<double> sums(values.size() + 1, 0), result(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) sums[i + 1] = sums[i] + values[i];
  const auto n = std::ssize(values);
  for (std::ptrdiff_t i = 0; i < n; ++i) {
    const auto low = static_cast<std::size_t>(std::max<std::ptrdiff_t>(0, i - reach));
    const auto high = static_cast<std::size_t>(std::min<std::ptrdiff_t>(n, i + reach + 1));
    result[static_cast<std::size_t>(i)] = (sums[high] - sums[low]) / static_cast<double>(high - low);
  }
  return result;
}

}  // namespace

FlightPath::FlightPath(const PlanePath& route, const GroundShape& ground, const FlightPathOptions& options,
                       std::uint64_t seed)
    : options_(options),
      ground_(ground),
      sway_(hash_of(seed, 71), 5.0),
      quick_(hash_of(seed, 72), 1.4),
      climb_(hash_of(seed, 73), 40) {
  const double speed = options.speed_mps;
  const double radius = speed * speed / (kStandardGravity_mps2 * std::tan(kUsualBank_rad));
  const double step = std::max(0.5, speed / 40);
  line_ = rounded(route, radius, step);
  if (line_.size() < 2) return;
  const std::size_t n = line_.size();
  arc_.assign(n, 0), course_.assign(n, 0), curvature_.assign(n, 0);
  std::vector<double> terrain(n);
  for (std::size_t i = 1; i < n; ++i) arc_[i] = arc_[i - 1] + (line_[i] - line_[i - 1]).norm();
  for (std::size_t i = 0; i + 1 < n; ++i) {
    const Eigen::Vector2d d = line_[i + 1] - line_[i];
    const double raw = std::atan2(d.x(), d.y());
    course_[i] = i == 0 ? raw : course_[i - 1] + wrap_pi(raw - course_[i - 1]);
  }
  course_[n - 1] = course_[n - 2];
  // Roll takes time: curvature_ and course_ change over about two seconds.
  course_ = smoothed(course_, static_cast<int>(0.8 * speed / step));
  for (std::size_t i = 1; i + 1 < n; ++i)
    curvature_[i] = (course_[i + 1] - course_[i - 1]) / std::max(1e-6, arc_[i + 1] - arc_[i - 1]);
  curvature_ = smoothed(curvature_, static_cast<int>(0.5 * speed / step));
  for (std::size_t i = 0; i < n; ++i) terrain[i] = ground.up_m(line_[i]);
  smooth_terrain_ = smoothed(terrain, static_cast<int>(350 / step));
  Random random = Random(seed).fork("path");
  crab_ = options.calm ? 0 : random.uniform(-0.07, 0.07);
}

FlightPose FlightPath::at(double time_s) const {
  const double speed = options_.speed_mps, s = time_s * speed;
  const auto wobble = [&](double t, int axis, double slow_deg, double quick_deg) {
    if (options_.calm) return 0.0;
    return radians(2.2 * (slow_deg * sway_.at(t, 13.7 * axis) + quick_deg * quick_.at(t, 7.3 * axis)));
  };
  const auto after = std::lower_bound(arc_.begin() + 1, arc_.end() - 1, s);
  const auto i = static_cast<std::size_t>(after - arc_.begin()) - 1;
  const double t = std::clamp((s - arc_[i]) / std::max(1e-9, arc_[i + 1] - arc_[i]), 0.0, 1.0);
  const auto between = [&](const std::vector<double>& v) { return std::lerp(v[i], v[i + 1], t); };
  FlightPose pose;
  pose.time_s = time_s;
  const PlanePoint plane = line_[i] + (line_[i + 1] - line_[i]) * t;
  const double heading = between(course_), rate = between(curvature_) * speed;
  const double lift = options_.calm ? 0 : 0.012 * options_.agl_m * climb_.at(time_s, 0.5);
  const double up = between(smooth_terrain_) + options_.agl_m + lift;
  pose.position = {plane.east_m, plane.north_m, up};
  pose.agl_m = up - ground_.up_m(plane);
  pose.pressure_agl_m = options_.agl_m + lift;
  pose.velocity_mps = Eigen::Vector2d(std::sin(heading), std::cos(heading)) * speed;
  // Coordinated turn: tan(bank) = v · rate / g, at most 30 degrees.
  const double bank = std::clamp(std::atan(rate * speed / kStandardGravity_mps2), -radians(30), radians(30));
  pose.attitude.heading_rad = heading + crab_ + wobble(time_s, 1, 0.9, 0.3);
  pose.attitude.pitch_rad = (options_.calm ? 0 : radians(1.5)) + wobble(time_s, 2, 1.1, 0.4);
  pose.attitude.roll_rad = bank + wobble(time_s, 3, 1.4, 0.5);
  return pose;
}

std::vector<FlightPose> simulate_flight_path(const PlanePath& route, const GroundShape& ground,
                                             const FlightPathOptions& options, std::uint64_t seed) {
  const FlightPath path(route, ground, options, seed);
  std::vector<FlightPose> poses;
  if (path.length_m() == 0) return poses;
  for (int k = 0; k < options.max_frames; ++k) {
    const double time_s = k * options.interval_s;
    if (time_s * options.speed_mps > path.length_m()) break;
    poses.push_back(path.at(time_s));
  }
  return poses;
}

}  // namespace nadir
