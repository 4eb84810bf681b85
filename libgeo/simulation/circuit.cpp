#include "simulation/circuit.hpp"

#include <algorithm>
#include <cmath>

#include "base/error.hpp"

namespace nadir {
namespace {

constexpr double kLost_m = 120;     // from the last nearest point: look everywhere
constexpr double kArcShare = 0.49;  // of a leg, at each of its ends
constexpr double kStraight_rad = 1e-6;

PlanePoint between(PlanePoint a, PlanePoint b, double t) {
  return {a.east_m + t * (b.east_m - a.east_m), a.north_m + t * (b.north_m - a.north_m)};
}

double from_segment_m(PlanePoint a, PlanePoint b, PlanePoint place) {
  const double east = b.east_m - a.east_m, north = b.north_m - a.north_m;
  const double square = east * east + north * north;
  const double along = (place.east_m - a.east_m) * east + (place.north_m - a.north_m) * north;
  return distance_m(place, between(a, b, square == 0 ? 0 : std::clamp(along / square, 0.0, 1.0)));
}

}  // namespace

Circuit::Circuit(std::span<const PlanePoint> corners, double turn_radius_m) : tightest_turn_m_(turn_radius_m) {
  if (corners.size() < 3) {
    throw UsageError({.what = "a circuit needs at least three corners", .found = std::to_string(corners.size())});
  }
  std::vector<PlanePoint> outline;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const PlanePoint corner = corners[i], before = corners[(i + corners.size() - 1) % corners.size()],
                     after = corners[(i + 1) % corners.size()];
    const double in_m = distance_m(before, corner), out_m = distance_m(corner, after);
    if (in_m < 1 || out_m < 1) throw UsageError({.what = "two corners of a circuit are at the same place"});
    // Directions as complex numbers would be: (east, north).
    const PlanePoint u{(corner.east_m - before.east_m) / in_m, (corner.north_m - before.north_m) / in_m};
    const PlanePoint v{(after.east_m - corner.east_m) / out_m, (after.north_m - corner.north_m) / out_m};
    const double turn = std::atan2(u.east_m * v.north_m - u.north_m * v.east_m,
                                   u.east_m * v.east_m + u.north_m * v.north_m);  // positive to the left
    if (std::abs(turn) < kStraight_rad) {
      outline.push_back(corner);
      continue;
    }
    const double half = std::tan(std::abs(turn) / 2);
    const double tangent_m = std::min({turn_radius_m * half, kArcShare * in_m, kArcShare * out_m});
    const double radius_m = tangent_m / half, side = turn > 0 ? 1 : -1;
    tightest_turn_m_ = std::min(tightest_turn_m_, radius_m);
    const PlanePoint start{corner.east_m - u.east_m * tangent_m, corner.north_m - u.north_m * tangent_m};
    const PlanePoint centre{start.east_m - side * u.north_m * radius_m, start.north_m + side * u.east_m * radius_m};
    const int steps = std::max(2, static_cast<int>(std::abs(turn) * radius_m / kSpacing_m) + 1);
    for (int k = 0; k <= steps; ++k) {
      const double c = std::cos(turn * k / steps), s = std::sin(turn * k / steps);
      const double east = start.east_m - centre.east_m, north = start.north_m - centre.north_m;
      outline.push_back({centre.east_m + east * c - north * s, centre.north_m + east * s + north * c});
    }
  }
  for (std::size_t i = 0; i < outline.size(); ++i) {
    const PlanePoint a = outline[i], b = outline[(i + 1) % outline.size()];
    const int steps = std::max(1, static_cast<int>(std::ceil(distance_m(a, b) / kSpacing_m)));
    for (int k = 0; k < steps; ++k) points_.push_back(between(a, b, static_cast<double>(k) / steps));
  }
}

PlanePoint Circuit::point(std::ptrdiff_t index) const {
  const auto count = static_cast<std::ptrdiff_t>(points_.size());
  return points_[static_cast<std::size_t>(((index % count) + count) % count)];
}

double Circuit::heading_rad(std::ptrdiff_t index) const {
  const PlanePoint a = point(index), b = point(index + 1);
  return std::atan2(b.east_m - a.east_m, b.north_m - a.north_m);
}

double Circuit::length_m() const {
  double sum_m = 0;
  for (std::size_t i = 0; i < points_.size(); ++i) sum_m += distance_m(points_[i], points_[(i + 1) % points_.size()]);
  return sum_m;
}

std::ptrdiff_t Circuit::nearest(PlanePoint place, std::optional<std::ptrdiff_t> near) const {
  const auto best = [&](std::ptrdiff_t from, std::ptrdiff_t to) {
    std::ptrdiff_t found = from;
    for (std::ptrdiff_t i = from; i < to; ++i) {
      if (distance_m(point(i), place) < distance_m(point(found), place)) found = i;
    }
    return found;
  };
  const auto count = static_cast<std::ptrdiff_t>(points_.size());
  if (near) {
    const std::ptrdiff_t index = best(*near - 5, *near + 20);
    if (distance_m(point(index), place) < kLost_m) return ((index % count) + count) % count;
  }
  return best(0, count);
}

double Circuit::off_track_m(PlanePoint place, std::ptrdiff_t nearest) const {
  return std::min(from_segment_m(point(nearest - 1), point(nearest), place),
                  from_segment_m(point(nearest), point(nearest + 1), place));
}

}  // namespace nadir
