#include "simulation/landscape.hpp"

#include <algorithm>
#include <cmath>

#include "base/random.hpp"
#include "simulation/fields.hpp"
#include "simulation/plants.hpp"
#include "simulation/village.hpp"
#include "simulation/ways.hpp"

namespace nadir {

double Relief::at(Spot spot) const {
  const double c = std::clamp(spot.x / step_m - 0.5, 0.0, heights_m.cols - 1.001);
  const double r = std::clamp((size_m - spot.y) / step_m - 0.5, 0.0, heights_m.rows - 1.001);
  const int ci = static_cast<int>(c), ri = static_cast<int>(r);
  const auto tc = static_cast<float>(c - ci), tr = static_cast<float>(r - ri);
  const float *a = heights_m[ri] + ci, *b = heights_m[ri + 1] + ci;
  return static_cast<double>((1 - tr) * ((1 - tc) * a[0] + tc * a[1]) + tr * ((1 - tc) * b[0] + tc * b[1]));
}

double Pond::edge_m(Spot spot) const {
  const Spot d = spot - centre;
  const double angle = std::atan2(d.y, d.x);
  double shape = 1;
  for (int k = 1; k <= 4; ++k) {
    const double phase = 6.283 * unit_hash(seed, k);
    shape += 0.16 / k * std::cos(k * angle + phase);
  }
  return cv::norm(d) - radius_m * shape;
}

namespace {

// Rolling hills with a valley along the river.
Relief make_relief(const Random& random, double size_m, const Way& river) {
  Random own = random.fork("relief");
  Relief relief;
  relief.size_m = size_m;
  const int nodes = std::max(8, static_cast<int>(std::lround(size_m / 8)));
  relief.step_m = size_m / nodes;
  const PixelGrid grid{relief.step_m, size_m, 0, 0, nodes, nodes};
  relief.heights_m = cv::Mat_<float>(nodes, nodes, 338.0F);
  for (const auto& [wavelength, amplitude] : {std::pair{1700.0, 17.0}, {800.0, 9.0}, {330.0, 3.2}, {140.0, 0.8}}) {
    Noise(static_cast<std::uint64_t>(own.uniform() * 0x1.0p53), wavelength).add(grid, amplitude, relief.heights_m);
  }
  for (int row = 0; row < nodes; ++row) {
    for (int column = 0; column < nodes; ++column) {
      const double d = distance_m(river, {grid.x(column), grid.y(row)});
      const double valley = std::exp(-d * d / (2 * 330.0 * 330.0));
      float& h = relief.heights_m(row, column);
      h = static_cast<float>(static_cast<double>(h) * (1 - 0.75 * valley) + (338.0 - 19.0) * 0.75 * valley);
    }
  }
  return relief;
}

}  // namespace

Landscape grow_landscape(std::uint64_t seed, double size_m) {
  const Random random(seed);
  Landscape land;
  land.seed = seed;
  land.size_m = size_m;
  lay_ways(random, land);
  land.relief = make_relief(random, size_m, land.river);
  DividedLand divided = divide_land(random, size_m);
  land.fields = std::move(divided.pattern);
  build_village(random, land);
  plant_crops(random, land);
  build_farms(random, land);
  plant_trees(random, divided.borders, land);
  return land;
}

}  // namespace nadir
