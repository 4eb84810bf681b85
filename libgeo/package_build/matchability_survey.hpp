// The matchability map: every cell of a grid over the mission's sectors and corridor, probed on its own
// (vision/matchability.hpp); its summary for the planner, and its GeoTIFF.
//
// Cells are squares of step_px by step_px pixels of one zoom's Web Mercator grid, counted from the world's north-west
// corner: a position has the same cell in every map of the same step, and a GeoTIFF in EPSG:3857 holds them exactly.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <utility>
#include <vector>

#include "base/progress.hpp"
#include "base/shared_work.hpp"
#include "geodesy/local_frame.hpp"
#include "geodesy/region.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/tile_source.hpp"
#include "package/manifest.hpp"
#include "raster/single_opencv_thread.hpp"
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
  // (0, 0): the grid's north-west corner; (0.5, 0.5): the centre of its first cell.
  LonLat lonlat_at(double column, double row) const;
};

struct MatchabilityMap {
  MatchabilityGrid grid;
  std::vector<PlaceMatchability> cells;  // rows from the north; MatchClass::outside where no map is needed

  // Null beyond the grid and outside of the region.
  const PlaceMatchability* at(LonLat position) const;
};

// A cell as bytes: its class, then ratio, score, entropy, texture and valid as IEEE 754 doubles, little-endian. Nothing
// for bytes that are no cell with a probe.
Bytes serialize_place(const PlaceMatchability& place);
std::optional<PlaceMatchability> parse_place(ByteView bytes);

// What the survey probes, and where: zoom of the grid's pixels; step_m: the side of the cells, rounded to whole pixels.
struct SurveyedGround {
  const TileSource& tiles;  // read from several threads
  const Region& region;
  const LocalFrame& frame;
  int zoom = 0;
  double step_m = 100;
};

// A task is a cell.
class MatchabilitySurvey final : public SharedWork {
 public:
  // ground: what it names must outlive the survey. Throws UsageError for more than kMaxMatchabilityCells.
  MatchabilitySurvey(const SurveyedGround& ground, const MatchabilityOptions& options);

  std::string what() const override { return "matchability"; }
  std::string description() const override;
  std::size_t tasks() const override { return needed_.size(); }
  Worker make_worker() const override;
  bool add(std::size_t task, ByteView result) override;

  MatchabilityMap take() { return std::move(map_); }  // after all results

 private:
  SingleOpenCvThread one_thread_;
  SurveyedGround ground_;
  MatchabilityMap map_;
  std::vector<std::size_t> needed_;  // cells
  MatchabilityProbe probe_;
};

// All of it here. The result does not depend on the number of threads.
MatchabilityMap survey_matchability(const TileSource& tiles, const Region& region, const LocalFrame& frame, int zoom,
                                    double step_m, const MatchabilityOptions& options, int threads, Progress& progress);

// A section of the route.
struct RouteSection {
  LonLat from, to;
  double begin_m = 0;  // along the route
  double length_m = 0;
};

// What a planner needs from a matchability map: how much of the ground is good, and how far the route runs without a
// position where a match is reliable.
struct MatchabilitySummary {
  std::array<std::size_t, 4> cells{};      // by MatchClass; outside: 0
  std::array<double, 4> route_m{};         // by MatchClass; outside: beyond the map
  std::vector<RouteSection> without_good;  // all of them, the longest first

  std::size_t places() const;
  double share(MatchClass cls) const;  // of the cells, 0 without any
  double route_length_m() const;
  double route_share(MatchClass cls) const;
};

MatchabilitySummary summarize_matchability(const MatchabilityMap& map, const std::vector<LonLat>& route,
                                           const LocalFrame& frame);

// The map as a GeoTIFF in EPSG:3857 (docs/formats/matchability.md), for QGIS and planning tools. Bands, float32: ratio,
// entropy, texture, class (1 good, 2 weak, 3 poor), score, valid; kMatchabilityNodata outside of the sectors and the
// corridor. Replaces the file atomically. The same map gives the same bytes.
void write_matchability_tiff(const MatchabilityMap& map, const std::filesystem::path& path);

}  // namespace nadir
