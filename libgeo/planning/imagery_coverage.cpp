#include "planning/imagery_coverage.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <vector>

#include "imagery/codecs.hpp"
#include "package/coverage_requirement.hpp"
#include "package/mission_check.hpp"
#include "planning/package_layers.hpp"

namespace nadir {
namespace {

using nlohmann::json;

constexpr std::int64_t kDay_s = 86'400;
constexpr std::size_t kPixels = std::size_t{kTileSize} * kTileSize;

struct OpenedImagery {
  ImagerySource source;
  std::shared_ptr<const TileSource> tiles;
};

std::vector<OpenedImagery> usable(const MapSources& sources) {
  std::vector<OpenedImagery> opened;
  for (ImagerySource& source : sources.imagery()) {
    auto tiles = source.problem.empty() ? sources.tiles(source.name) : nullptr;
    if (tiles) opened.push_back({std::move(source), std::move(tiles)});
  }
  return opened;
}

// The finest zoom of the mission that no source is too coarse for and that has at most so many tiles.
std::vector<TileKey> tiles_to_look_at(const Mission& mission, const std::vector<OpenedImagery>& imagery,
                                      std::size_t most) {
  int zoom = mission.zoom.max;
  for (const OpenedImagery& one : imagery) zoom = std::min(zoom, one.tiles->zooms().max);
  std::vector<TileKey> keys = required_tiles(mission, zoom);
  while (keys.size() > most && zoom > 0) keys = required_tiles(mission, --zoom);
  return keys;
}

void add_valid_pixels(const TileSource& tiles, const TileKey& key, Bytes& mask) {
  const auto bytes = tiles.read(key);
  if (!bytes) return;
  const cv::Mat alpha = decode_image(*bytes, Colour::grey, to_text(key)).alpha;
  for (std::size_t i = 0; i < kPixels; ++i) {
    if (alpha.empty() || alpha.data[i] != 0) mask[i] = 255;
  }
}

}  // namespace

json imagery_coverage_geojson(const Mission& mission, const MapSources& sources, UtcTime at, std::size_t most) {
  const std::vector<OpenedImagery> imagery = usable(sources);
  const LocalFrame frame = mission_frame(mission);
  const CoverageRequirement need(required_region(mission, frame));
  const std::vector<TileKey> keys = tiles_to_look_at(mission, imagery, most);
  double needed_m2 = 0, missing_m2 = 0;
  json features = json::array();
  for (const TileKey& key : keys) {
    const TileFootprint footprint(frame, key);
    const Sector* const sector = governing_sector(mission, frame, key);
    const std::int64_t limit_days = mission.freshness_days.of(sector == nullptr ? SectorClass::active : sector->cls);
    Bytes any(kPixels, 0), good(kPixels, 0);
    for (const auto& [source, tiles] : imagery) {
      add_valid_pixels(*tiles, key, any);
      const bool fresh = source.captured_at && (at.unix_s - source.captured_at->unix_s) <= limit_days * kDay_s;
      if (fresh && source.gsd_m <= mission.min_resolution_m) add_valid_pixels(*tiles, key, good);
    }
    const auto area_m2 = [&](ByteView pixels) {
      return static_cast<double>(kPixels - static_cast<std::size_t>(std::count(pixels.begin(), pixels.end(), 0))) *
             footprint.pixel_area_m2();
    };
    const Bytes without = need.missing_mask(footprint, any);
    Bytes unusable = need.missing_mask(footprint, good);
    for (std::size_t i = 0; i < kPixels; ++i) {
      if (without[i] != 0) unusable[i] = 0;
    }
    needed_m2 += area_m2(need.missing_mask(footprint, {}));
    const std::pair<const char*, const Bytes*> gaps[] = {{"no imagery", &without},
                                                         {"imagery too old or too coarse", &unusable}};
    for (const auto& [reason, mask] : gaps) {
      const double gap_m2 = area_m2(*mask);
      if (gap_m2 == 0) continue;
      missing_m2 += gap_m2;
      features.push_back({{"type", "Feature"},
                          {"geometry", pixels_geojson(key, *mask)},
                          {"properties",
                           {{"tile", to_text(key)},
                            {"reason", reason},
                            {"area_m2", std::round(gap_m2)},
                            {"sector", sector == nullptr ? json() : json(sector->id)}}}});
    }
  }
  return {{"type", "FeatureCollection"},
          {"zoom", keys.empty() ? mission.zoom.max : int{keys.front().z}},
          {"needed_m2", std::round(needed_m2)},
          {"missing_m2", std::round(missing_m2)},
          {"features", std::move(features)}};
}

}  // namespace nadir
