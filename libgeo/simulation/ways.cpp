#include "simulation/ways.hpp"

#include <algorithm>
#include <cmath>

namespace nadir {

std::vector<Spot> smooth_curve(const std::vector<Spot>& knots, double step_m) {
  std::vector<Spot> points;
  const auto knot = [&](std::ptrdiff_t i) {
    return knots[static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(i, 0, std::ssize(knots) - 1))];
  };
  for (std::ptrdiff_t i = 0; i + 1 < std::ssize(knots); ++i) {
    const Spot a = knot(i - 1), b = knot(i), c = knot(i + 1), d = knot(i + 2);
    const int steps = std::max(1, static_cast<int>(cv::norm(c - b) / step_m));
    for (int s = 0; s < steps; ++s) {
      const double t = static_cast<double>(s) / steps;
      points.push_back((b * 2.0 + (c - a) * t + (a * 2.0 - b * 5.0 + c * 4.0 - d) * (t * t) +
                        (b * 3.0 - a - c * 3.0 + d) * (t * t * t)) *
                       0.5);
    }
  }
  points.push_back(knots.back());
  return points;
}

double distance_m(const Way& way, Spot spot) {
  double best = 1e18;
  for (std::size_t i = 0; i + 1 < way.points.size(); ++i) {
    const Spot a = way.points[i], ab = way.points[i + 1] - a, ap = spot - a;
    const double t = std::clamp(ap.dot(ab) / std::max(ab.dot(ab), 1e-9), 0.0, 1.0);
    const Spot gap = ap - ab * t;
    best = std::min(best, gap.dot(gap));
  }
  return std::sqrt(best);
}

void lay_ways(const Random& random, Landscape& land) {
  Random own = random.fork("ways");
  const double size = land.size_m, rim = 200;
  const bool flip = own.chance(0.5), turn = own.chance(0.5);
  const auto place = [&](double x, double y) {  // from a drawing in which the river runs west to east
    if (flip) y = size - y;
    return turn ? Spot(y, x) : Spot(x, y);
  };
  // The river meanders about a sloping line.
  const double y0 = own.uniform(0.60, 0.74) * size, y1 = own.uniform(0.62, 0.8) * size;
  std::vector<Spot> knots;
  double swing = own.chance(0.5) ? 1 : -1;
  for (double x = -rim; x < size + rim + 200; x += own.uniform(130, 210)) {
    const double along = std::clamp(x / size, 0.0, 1.0);
    knots.push_back(place(x, y0 + (y1 - y0) * along + swing * own.uniform(15, 75)));
    swing = own.chance(0.8) ? -swing : swing;
  }
  land.river.points = smooth_curve(knots, 8);
  const Noise width(static_cast<std::uint64_t>(own.uniform() * 0x1.0p53), 110);
  const double half = own.uniform(8, 12);
  for (const Spot& p : land.river.points) land.river.half_widths_m.push_back(half * (1 + 0.45 * width.at(p.x, p.y)));

  // The main road crosses it and passes the village.
  const Spot village(own.uniform(0.44, 0.54) * size, own.uniform(0.36, 0.46) * size);
  land.village = place(village.x, village.y);
  std::vector<Spot> road;
  const double wave = 0.035 * size;
  road.push_back(place(own.uniform(0.15, 0.35) * size, -rim));
  road.push_back(place(village.x - own.uniform(0.02, 0.14) * size, village.y * 0.35));
  road.push_back(place(village.x - own.uniform(0, wave), village.y - 0.5 * 240));
  road.push_back(place(village.x, village.y));
  road.push_back(place(village.x + own.uniform(0, wave), village.y + 0.5 * 260));
  road.push_back(place(village.x + own.uniform(-wave, 2 * wave), (village.y + size) * 0.5));
  road.push_back(place(own.uniform(0.55, 0.8) * size, size * 0.86));
  road.push_back(place(own.uniform(0.6, 0.9) * size, size + rim));
  Way main;
  main.points = smooth_curve(road, 8);
  main.half_widths_m.assign(main.points.size(), 3.4);
  land.roads.push_back(std::move(main));

  const int ponds = std::max(1, static_cast<int>(size * size / 2.5e6));
  for (int i = 0; i < ponds; ++i) {
    const Spot spot = place(own.uniform(0.12, 0.88) * size, own.uniform(0.1, 0.55) * size);
    if (cv::norm(spot - land.village) < 300 || distance_m(land.roads[0], spot) < 90) continue;
    land.ponds.push_back({spot, own.uniform(18, 42), hash_of(land.seed, 77, i)});
  }
}

}  // namespace nadir
