#include "commands/cache/report/coverage_map.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "commands/cache/report/matchability_layer.hpp"
#include "geodesy/web_mercator.hpp"
#include "package/coverage_gaps.hpp"
#include "package/mission_check.hpp"
#include "package/coverage_requirement.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr std::size_t kMaxCells = 8000;     // what a browser draws and moves without a jerk
constexpr std::size_t kMaxOutlines = 1000;  // gaps that are outlined; more show as cells alone
constexpr std::int64_t kSecondsPerDay = 86'400;

// From good to bad: a cell of several tiles shows the last that applies.
enum class State { spare, good, stale, partial, gap };
constexpr const char* kNames[] = {"spare", "good", "stale", "partial", "gap"};

struct Cell {
  State state = State::spare;
  const Sidecar* oldest = nullptr;
  int limit_days = 0;  // of the oldest, by its sector
  double gap_m2 = 0;
  std::size_t tiles = 0;
};

double rounded(double value, double steps) { return std::round(value * steps) / steps; }

class Map {
 public:
  explicit Map(const CacheReport& report)
      : report_(report), mission_(*report.mission), frame_(mission_frame(mission_)), finest_(mission_.zoom.max) {
    const std::vector<TileKey> required = required_tiles(mission_, finest_);
    required_.insert(required.begin(), required.end());
    std::copy_if(report.tiles.begin(), report.tiles.end(), std::back_inserter(tiles_),
                 [this](const Sidecar& tile) { return tile.key.z == finest_; });
    gaps_ = find_gaps(mission_, report.tiles, finest_);
    choose_zoom();
    GlobalPixel origin = pixel(mission_.takeoff);
    origin_ = {std::floor(origin.x / kTileSize) * kTileSize, std::floor(origin.y / kTileSize) * kTileSize};
  }

  json document() {
    fill();
    json data{
        {"zoom", zoom_},
        {"finest", finest_},
        {"cell_size", kTileSize << (finest_ - zoom_)},
        {"metres_per_pixel", ground_resolution_m(finest_, mission_.takeoff.lat_deg)},
        {"half_width", mission_.route.corridor_half_width_m / ground_resolution_m(finest_, mission_.takeoff.lat_deg)},
        {"takeoff", place(mission_.takeoff)},
        {"dated", report_.dated},
        {"cells", cells()},
        {"route", places(mission_.route.points)},
        {"sectors", sectors()},
        {"gaps", outlines()},
        {"gap_count", gaps_.size()}};
    double gap_m2 = 0;
    for (const Gap& gap : gaps_) gap_m2 += gap.area_m2;
    data["gap_m2"] = rounded(gap_m2, 1);
    data["needed_m2"] = rounded(needed_m2(), 1);
    if (report_.matchability) data["matchability"] = matchability_layer(*report_.matchability, mission_, origin_);
    return data;
  }

 private:
  GlobalPixel pixel(LonLat where) const { return pixel_from_lonlat(where, finest_); }
  json place(LonLat where) const {
    const GlobalPixel at = pixel(where);
    return {rounded(at.x - origin_.x, 10), rounded(at.y - origin_.y, 10)};
  }
  json places(const std::vector<LonLat>& points) const {
    json list = json::array();
    for (const LonLat& point : points) list.push_back(place(point));
    return list;
  }
  TileKey at_zoom(const TileKey& key) const {
    const int steps = finest_ - zoom_;
    return {static_cast<std::uint8_t>(zoom_), key.x >> steps, key.y >> steps};
  }

  void choose_zoom() {
    for (zoom_ = finest_; zoom_ > 0; --zoom_) {
      std::set<TileKey> keys;
      for (const TileKey& key : required_) keys.insert(at_zoom(key));
      for (const Sidecar& tile : tiles_) keys.insert(at_zoom(tile.key));
      if (keys.size() <= kMaxCells) return;
    }
  }

  void worsen(Cell& cell, State state) { cell.state = std::max(cell.state, state); }

  void fill() {
    for (const Sidecar& tile : tiles_) {
      Cell& cell = cells_[at_zoom(tile.key)];
      ++cell.tiles;
      const Sector* sector = governing_sector(mission_, frame_, tile.key);
      const int limit = mission_.freshness_days.of(sector == nullptr ? SectorClass::active : sector->cls);
      if (cell.oldest == nullptr || tile.captured_at < cell.oldest->captured_at) {
        cell.oldest = &tile;
        cell.limit_days = limit;
      }
      const bool needed = required_.contains(tile.key);
      const bool stale = report_.dated && report_.at.unix_s - tile.captured_at.unix_s > limit * kSecondsPerDay;
      worsen(cell, !needed ? State::spare : stale ? State::stale : State::good);
    }
    for (const Gap& gap : gaps_) {
      Cell& cell = cells_[at_zoom(gap.key)];
      cell.gap_m2 += gap.area_m2;
      worsen(cell, gap.whole_tile && zoom_ == finest_ ? State::gap : State::partial);
      if (cell.tiles == 0) worsen(cell, State::gap);
    }
  }

  json cells() const {
    json list = json::array();
    for (const auto& [key, cell] : cells_) {
      const double size = std::exp2(finest_ - zoom_) * kTileSize;
      json item{{"x", key.x * size - origin_.x},
                {"y", key.y * size - origin_.y},
                {"tile", to_text(key)},
                {"state", kNames[static_cast<std::size_t>(cell.state)]}};
      if (cell.gap_m2 > 0) item["gap_m2"] = rounded(cell.gap_m2, 1);
      if (cell.tiles > 1) item["tiles"] = cell.tiles;
      if (const Sidecar* tile = cell.oldest; tile != nullptr) {
        item["valid"] = rounded(static_cast<double>(tile->valid_ppm) / 1e4, 10);
        if (report_.dated) {
          item["captured"] = to_rfc3339(tile->captured_at).substr(0, 10);
          item["age"] = (report_.at.unix_s - tile->captured_at.unix_s) / kSecondsPerDay;
          item["limit"] = cell.limit_days;
          item["gsd_mm"] = tile->gsd_mm;
          item["ce90_mm"] = tile->ce90_mm;
          item["source"] = tile->source;
        }
      }
      list.push_back(std::move(item));
    }
    return list;
  }

  json sectors() const {
    json list = json::array();
    for (const Sector& sector : mission_.sectors) {
      list.push_back({{"id", sector.id},
                      {"class", name_of(sector.cls)},
                      {"limit", mission_.freshness_days.of(sector.cls)},
                      {"km2", rounded(std::abs(area_m2(to_plane(frame_, sector.polygon))) / 1e6, 1e4)},
                      {"points", places(sector.polygon)}});
    }
    return list;
  }

  json outlines() const {
    json list = json::array();
    if (gaps_.size() > kMaxOutlines) return list;
    for (const Gap& gap : gaps_) {
      for (const PixelPolygon& polygon : outlines_of(gap, mission_, report_.tiles)) {
        json rings = json::array({ring(gap.key, polygon.outer)});
        for (const PixelRing& hole : polygon.holes) rings.push_back(ring(gap.key, hole));
        list.push_back(std::move(rings));
      }
    }
    return list;
  }
  json ring(const TileKey& key, const PixelRing& corners) const {
    json points = json::array();
    for (const PixelCorner& corner : corners) {
      points.push_back({static_cast<double>(key.x) * kTileSize + corner.column - origin_.x,
                        static_cast<double>(key.y) * kTileSize + corner.row - origin_.y});
    }
    return points;
  }

  double needed_m2() const {
    const CoverageRequirement need(required_region(mission_, frame_));
    double area = 0;
    for (const TileKey& key : required_) {
      const TileFootprint footprint(frame_, key);
      area += static_cast<double>(need.missing_pixels(footprint, {})) * footprint.pixel_area_m2();
    }
    return area;
  }

  const CacheReport& report_;
  const Mission& mission_;
  LocalFrame frame_;
  int finest_;
  int zoom_ = 0;
  GlobalPixel origin_;
  std::set<TileKey> required_;
  std::vector<Sidecar> tiles_;  // of the finest zoom
  std::vector<Gap> gaps_;
  std::map<TileKey, Cell> cells_;
};

}  // namespace

json coverage_map(const CacheReport& report) { return Map(report).document(); }

}  // namespace nadir
