#include "commands/cache/cache_report.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <utility>

#include "base/csv.hpp"
#include "base/error.hpp"
#include "base/files.hpp"
#include "base/printable.hpp"
#include "cli/nadir_version.hpp"
#include "geodesy/web_mercator.hpp"
#include "map_page/map_page.hpp"
#include "package/coverage_gaps.hpp"
#include "package/coverage_requirement.hpp"
#include "package/mission_check.hpp"
#include "report/page_text.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr std::size_t kMaxBlocks = 8000;  // of the matchability layer: what a browser draws and moves without a jerk
constexpr std::size_t kMaxStretches = 20;

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
    at_m += distance_m(path[i], path[i - 1]);
    if (at_m > stretch.begin_m && at_m < stretch.begin_m + stretch.length_m) points.push_back(mission.route.points[i]);
  }
  points.push_back(stretch.to);
  return points;
}

// The matchability map as a layer of the report's map, in its pixels: {cell_size, cells, stretches, and what json_of()
// says}. cells: [x, y, class, ratio, score, entropy, texture, valid]. Very many places are shown in blocks, each as the
// worst place in it.
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

constexpr std::size_t kMaxCells = 8000;           // what a browser draws and moves without a jerk
constexpr std::size_t kMaxShownVectors = 50'000;  // what a page still loads at once
constexpr std::size_t kMaxOutlines = 1000;        // gaps that are outlined; more show as cells alone
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
    if (report_.vectors) data["vectors"] = vectors();
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

  // As the package has them, in this map's pixels. Of very many the smallest would not be seen anyway.
  json vectors() const {
    json features = json::array();
    for (const MapVector& vector : report_.vectors->features) {
      if (features.size() == kMaxShownVectors) break;
      json parts = json::array();
      for (const std::vector<LonLat>& part : vector.parts) parts.push_back(places(part));
      features.push_back({{"properties", {{"class", name_of(vector.cls)}, {"kind", vector.kind}}},
                          {"geometry",
                           {{"type", vector.is_area ? "Polygon" : "LineString"},
                            {"coordinates", vector.is_area ? parts : parts.front()}}}});
    }
    return {{"attribution", report_.vectors->attribution},
            {"licence", report_.vectors->licence},
            {"left_out", report_.vectors->features.size() - features.size()},
            {"features", std::move(features)}};
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

// Tiles with their state, sectors, route and gaps, in pixels of the mission's finest zoom relative to `origin` (x east,
// y south): {cells, cell_size, zoom, metres_per_pixel, sectors, route, half_width, gaps, summary, matchability where it
// was asked for}. A set with very many tiles is shown at a coarser zoom, each cell as bad as the worst tile in it.
json coverage_map(const CacheReport& report) { return Map(report).document(); }

// Inside a table of Markdown.
std::string markdown_cell(const std::string& text) {
  std::string cell;
  for (const char c : printable(text)) {
    if (c == '<') {
      cell += "&lt;";
    } else {
      if (std::string_view("\\|`*_[]#&").find(c) != std::string_view::npos) cell += '\\';
      cell += c;
    }
  }
  return cell;
}

json document_of(const CacheReport& report) {
  json document = json_from(report.findings);
  document["subject"] = report.title;
  document["judged_at"] = to_rfc3339(report.at);
  json& figures = document["figures"] = json::array();
  for (const auto& [name, value] : report.figures) figures.push_back({{"name", name}, {"value", value}});
  return document;
}

std::string findings_text(const CacheReport& report) {
  std::ostringstream out;
  print_figures(out, report.figures);
  out << "evaluated as of " << to_rfc3339(report.at) << "\n\n";
  print_findings(out, report.findings);
  return out.str();
}

}  // namespace

std::string findings_csv(const Findings& findings) {
  std::string csv = "code,severity,where,expected,found,fix\r\n";
  for (const Finding& finding : findings.items()) {
    std::vector<std::string> cells;
    for (const auto& text : {finding.code, std::string(name_of(finding.severity)), finding.where, finding.expected,
                             finding.found, finding.fix}) {
      cells.push_back(spreadsheet_cell(printable(text)));
    }
    csv += fmt::format("{}\r\n", fmt::join(cells, ","));
  }
  return csv;
}

std::string findings_markdown(const CacheReport& report) {
  std::string text = fmt::format("# {}\n\n**{}**, evaluated as of {}.\n\n", markdown_cell(report.title),
                                 report.findings.has_errors() ? "Rejected" : "Accepted", to_rfc3339(report.at));
  text += "| | |\n|---|---|\n";
  for (const auto& [name, value] : report.figures) {
    text += fmt::format("| {} | {} |\n", markdown_cell(name), markdown_cell(value));
  }
  if (report.findings.empty()) return text + "\nNo findings.\n";
  text += "\n| code | severity | where | expected | found | fix |\n|---|---|---|---|---|---|\n";
  for (const Finding& finding : report.findings.items()) {
    text += fmt::format("| {} | {} | {} | {} | {} | {} |\n", markdown_cell(finding.code), name_of(finding.severity),
                        markdown_cell(finding.where), markdown_cell(finding.expected), markdown_cell(finding.found),
                        markdown_cell(finding.fix));
  }
  return text;
}

std::string cache_report_html(const CacheReport& report) {
  json data = document_of(report);
  data["title"] = report.title;
  data["subtitle"] = report.subtitle;
  data["generator"] = fmt::format("Created by nadir {}", kVersion);
  data["map"] = report.mission ? coverage_map(report) : json();
  const std::string text = script_safe(data), title = html_escaped(report.title);
  const std::string style = fmt::format("{}\n{}", map_page::leaflet_style, cache_report_page::style);
  const std::string script = fmt::format("{}\n{}{}{}", map_page::leaflet_script, cache_report_page::dom,
                                         map_page::base_map, cache_report_page::script);
  return fill_page(cache_report_page::html, {{"title", title}, {"style", style}, {"data", text}, {"script", script}});
}

void write_cache_report(const std::filesystem::path& folder, const CacheReport& report) {
  std::error_code problem;
  std::filesystem::create_directories(folder, problem);
  if (problem || !std::filesystem::is_directory(folder)) {
    throw Error({.what = "cannot create the report folder",
                 .where = folder.string(),
                 .found = problem ? problem.message() : "not a folder",
                 .fix = "choose another folder for --report"});
  }
  const std::string document = document_of(report).dump(2, ' ', false, json::error_handler_t::replace) + "\n";
  write_file_atomic(folder / "findings.txt", findings_text(report));
  write_file_atomic(folder / "findings.json", document);
  write_file_atomic(folder / "findings.csv", findings_csv(report.findings));
  write_file_atomic(folder / "findings.md", findings_markdown(report));
  write_file_atomic(folder / "report.html", cache_report_html(report));
}

}  // namespace nadir
