#include "commands/cache/report/matchability_layer.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

namespace nadir {
namespace {

using nlohmann::json;

constexpr std::size_t kMaxBlocks = 8000;  // what a browser draws and moves without a jerk
constexpr std::size_t kMaxStretches = 20;

double rounded(double value, double steps) { return std::round(value * steps) / steps; }

bool worse(const PlaceMatchability& a, const PlaceMatchability& b) {
  return a.cls != b.cls ? a.cls > b.cls : a.ratio > b.ratio;
}

using Blocks = std::map<std::pair<int, int>, const PlaceMatchability*>;  // by row and column of blocks

Blocks blocks_of(const MatchabilityMap& map, int side) {
  Blocks blocks;
  for (int row = 0; row < map.grid.rows; ++row) {
    for (int column = 0; column < map.grid.columns; ++column) {
      const PlaceMatchability& cell =
          map.cells[static_cast<std::size_t>(row) * static_cast<std::size_t>(map.grid.columns) +
                    static_cast<std::size_t>(column)];
      if (cell.cls == MatchClass::outside) continue;
      const PlaceMatchability*& block = blocks[{row / side, column / side}];
      if (block == nullptr || worse(cell, *block)) block = &cell;
    }
  }
  return blocks;
}

// The corners of the route between two places on it.
std::vector<LonLat> along_route(const RouteSection& stretch, const Mission& mission, const LocalFrame& frame) {
  std::vector<LonLat> points{stretch.from};
  const PlaneRing path = to_plane(frame, mission.route.points);
  double at_m = 0;
  for (std::size_t i = 1; i < path.size(); ++i) {
    at_m += std::hypot(path[i].east_m - path[i - 1].east_m, path[i].north_m - path[i - 1].north_m);
    if (at_m > stretch.begin_m && at_m < stretch.begin_m + stretch.length_m) points.push_back(mission.route.points[i]);
  }
  points.push_back(stretch.to);
  return points;
}

}  // namespace

json matchability_layer(const MatchabilityResult& result, const Mission& mission, GlobalPixel origin) {
  const MatchabilityGrid& grid = result.map.grid;
  int side = 1;
  Blocks blocks = blocks_of(result.map, side);
  while (blocks.size() > kMaxBlocks) blocks = blocks_of(result.map, ++side);

  json layer = json_of(result);
  const double size = static_cast<double>(grid.step_px) * side;
  layer["cell_size"] = size;
  layer["places_per_cell"] = side * side;
  json& cells = layer["cells"] = json::array();
  const GlobalPixel corner = grid.north_west();
  for (const auto& [at, place] : blocks) {
    cells.push_back({corner.x + at.second * size - origin.x, corner.y + at.first * size - origin.y, name_of(place->cls),
                     rounded(place->ratio, 100), rounded(place->score, 100), rounded(place->entropy, 100),
                     rounded(place->texture, 10), rounded(place->valid, 100)});
  }
  const LocalFrame frame = mission_frame(mission);
  json& stretches = layer["stretches"] = json::array();
  const auto& without = result.summary.without_good;
  for (std::size_t i = 0; i < std::min(kMaxStretches, without.size()); ++i) {
    json points = json::array();
    for (const LonLat& point : along_route(without[i], mission, frame)) {
      const GlobalPixel pixel = pixel_from_lonlat(point, grid.zoom);
      points.push_back({rounded(pixel.x - origin.x, 10), rounded(pixel.y - origin.y, 10)});
    }
    stretches.push_back(std::move(points));
  }
  return layer;
}

}  // namespace nadir
