#include "estimation/terrain_surface.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

namespace nadir {
namespace {

using namespace parameters::terrain;

// The smallest box of the plane around the raster: its border bulges a little, so it is walked.
PlaneBox box_around(const TerrainGrid& grid, const LocalFrame& frame) {
  constexpr int kSteps = 16;
  constexpr double infinity = std::numeric_limits<double>::infinity();
  PlaneBox box{infinity, infinity, -infinity, -infinity};
  const auto include = [&](double across, double down) {
    const PlanePoint at = frame.plane_from_lonlat(grid.place(across * grid.columns - 0.5, down * grid.rows - 0.5));
    box.west_m = std::min(box.west_m, at.east_m), box.east_m = std::max(box.east_m, at.east_m);
    box.south_m = std::min(box.south_m, at.north_m), box.north_m = std::max(box.north_m, at.north_m);
  };
  for (int i = 0; i <= kSteps; ++i) {
    const double along = static_cast<double>(i) / kSteps;
    include(along, 0), include(along, 1), include(0, along), include(1, along);
  }
  return box;
}

// Known posts grow into the holes, one ring of neighbours after the other.
std::vector<float> without_holes(std::span<const float> heights, const TerrainGrid& grid) {
  std::vector<float> filled(heights.begin(), heights.end());
  std::vector<std::size_t> front;
  for (std::size_t i = 0; i < filled.size(); ++i) {
    if (!std::isnan(filled[i])) front.push_back(i);
  }
  if (front.empty()) {
    std::fill(filled.begin(), filled.end(), 0.0F);
    return filled;
  }
  const auto columns = static_cast<std::size_t>(grid.columns);
  while (!front.empty()) {
    std::vector<std::size_t> next;
    for (const std::size_t i : front) {
      const auto grow = [&](bool inside, std::size_t to) {
        if (!inside || !std::isnan(filled[to])) return;
        filled[to] = filled[i];
        next.push_back(to);
      };
      grow(i % columns > 0, i - 1);
      grow(i % columns + 1 < columns, i + 1);
      grow(i >= columns, i - columns);
      grow(i + columns < filled.size(), i + columns);
    }
    front = std::move(next);
  }
  return filled;
}

// Where a position lies in a table: the cell before it and the share of that cell.
struct Cell {
  std::size_t index = 0;
  double share = 0;
};
Cell cell_of(double at, int nodes) {
  if (nodes < 2 || !(at > 0)) return {};  // NaN too
  const double inside = std::min(at, nodes - 1.0);
  const auto index = std::min(static_cast<std::size_t>(inside), static_cast<std::size_t>(nodes - 2));
  return {index, inside - static_cast<double>(index)};
}

}  // namespace

TerrainSurface::TerrainSurface(const TerrainRaster& raster, const LocalFrame& frame, double plane_height_m,
                               double relief_sigma_m)
    : frame_(frame),
      grid_(raster.grid()),
      heights_m_(raster.heights_m()),
      plane_height_m_(plane_height_m),
      relief_sigma_m_(relief_sigma_m),
      box_(box_around(grid_, frame)) {
  if (!raster.known(0, 0, grid_.columns - 1, grid_.rows - 1)) {
    filled_ = without_holes(heights_m_, grid_);
    heights_m_ = filled_;
  }
  const double width_m = box_.east_m - box_.west_m, height_m = box_.north_m - box_.south_m;
  cell_m_ = std::max(kMinCell_m, std::max(width_m, height_m) / kMaxCells);
  cell_columns_ = static_cast<int>(std::ceil(width_m / cell_m_)) + 1;
  cell_rows_ = static_cast<int>(std::ceil(height_m / cell_m_)) + 1;
  posts_.reserve(static_cast<std::size_t>(cell_columns_) * static_cast<std::size_t>(cell_rows_));
  for (int row = 0; row < cell_rows_; ++row) {
    for (int column = 0; column < cell_columns_; ++column) {
      const LonLat place = frame.lonlat_from_plane({box_.west_m + column * cell_m_, box_.south_m + row * cell_m_});
      posts_.push_back({grid_.column_of(place.lon_deg), grid_.row_of(place.lat_deg)});
    }
  }
}

TerrainSurface::Post TerrainSurface::post_at(PlanePoint point) const {
  const Cell x = cell_of((std::clamp(point.east_m, box_.west_m, box_.east_m) - box_.west_m) / cell_m_, cell_columns_);
  const Cell y = cell_of((std::clamp(point.north_m, box_.south_m, box_.north_m) - box_.south_m) / cell_m_, cell_rows_);
  const auto stride = static_cast<std::size_t>(cell_columns_);
  const Post* south = posts_.data() + y.index * stride + x.index;
  const Post* north = south + stride;
  const auto blend = [&](double sw, double se, double nw, double ne) {
    return (1 - y.share) * ((1 - x.share) * sw + x.share * se) + y.share * ((1 - x.share) * nw + x.share * ne);
  };
  return {blend(south[0].column, south[1].column, north[0].column, north[1].column),
          blend(south[0].row, south[1].row, north[0].row, north[1].row)};
}

double TerrainSurface::raster_height_m(Post post) const {
  const Cell x = cell_of(post.column, grid_.columns), y = cell_of(post.row, grid_.rows);
  const auto stride = static_cast<std::size_t>(grid_.columns);
  const std::size_t right = grid_.columns > 1 ? 1 : 0, down = grid_.rows > 1 ? stride : 0;
  const float* at = heights_m_.data() + y.index * stride + x.index;
  const auto value = [at](std::size_t offset) { return static_cast<double>(at[offset]); };
  return (1 - y.share) * ((1 - x.share) * value(0) + x.share * value(right)) +
         y.share * ((1 - x.share) * value(down) + x.share * value(down + right));
}

double TerrainSurface::height_m(PlanePoint point) const { return raster_height_m(post_at(point)) - plane_height_m_; }

double TerrainSurface::msl_m(const LonLat& place) const {
  return plane_height_m_ + height_m(frame_.plane_from_lonlat(place));
}

Eigen::Vector2d ground_slope(const GroundSurface& surface, PlanePoint at, double baseline_m) {
  const auto rise = [&](double east, double north) {
    return surface.height_m({at.east_m + east * baseline_m, at.north_m + north * baseline_m}) -
           surface.height_m({at.east_m - east * baseline_m, at.north_m - north * baseline_m});
  };
  return Eigen::Vector2d(rise(1, 0), rise(0, 1)) / (2 * baseline_m);
}

}  // namespace nadir
