// The matchability map: every cell of a grid over the mission's sectors and corridor, probed on its own
// (vision/matchability.hpp).
//
// Cells are squares of step_px by step_px pixels of one zoom's Web Mercator grid, counted from the world's north-west
// corner: a place has the same cell in every map of the same step, and a GeoTIFF in EPSG:3857 holds them exactly.
#pragma once

#include <cstdint>
#include <vector>

#include "base/progress.hpp"
#include "geodesy/local_frame.hpp"
#include "geodesy/region.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/tile_source.hpp"
#include "vision/matchability.hpp"

namespace nadir {

struct MatchabilityGrid {
  int zoom = 0;
  int step_px = 1;
  std::int64_t first_column = 0;  // of the world's cells of this size
  std::int64_t first_row = 0;     // southwards
  int columns = 0;
  int rows = 0;

  std::size_t cells() const { return static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows); }
  GlobalPixel north_west() const {
    return {static_cast<double>(first_column) * step_px, static_cast<double>(first_row) * step_px};
  }
  // (0, 0): the grid's north-west corner; (0.5, 0.5): the middle of its first cell.
  LonLat place(double column, double row) const;
};

struct MatchabilityMap {
  MatchabilityGrid grid;
  std::vector<PlaceMatchability> cells;  // rows from the north; MatchClass::outside where nothing is needed

  // Null beyond the grid and outside of what was asked for.
  const PlaceMatchability* at(LonLat place) const;
};

inline constexpr std::size_t kMaxMatchabilityCells = 1'000'000;

// zoom: whose pixels count the grid. step_m: the cells' side, to the next whole pixel. Throws Error when that makes
// more than kMaxMatchabilityCells. `tiles` is read from several threads. The result does not depend on how many there
// are.
MatchabilityMap survey_matchability(const TileSource& tiles, const Region& region, const LocalFrame& frame, int zoom,
                                    double step_m, const MatchabilityOptions& options, int threads, Progress& progress);

}  // namespace nadir
