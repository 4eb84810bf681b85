#include "package_build/build_plan.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <set>

#include "geodesy/angles.hpp"
#include "imagery/codecs.hpp"
#include "package/coverage_requirement.hpp"
#include "package/mission_check.hpp"
#include "raster/mosaic.hpp"

namespace nadir {
namespace {

struct PixelBox {
  double left = 1e300, top = 1e300, right = -1e300, bottom = -1e300;

  void add(GlobalPixel pixel) {
    left = std::min(left, pixel.x), right = std::max(right, pixel.x);
    top = std::min(top, pixel.y), bottom = std::max(bottom, pixel.y);
  }
  bool meets(const PixelBox& other) const {
    return left < other.right && other.left < right && top < other.bottom && other.top < bottom;
  }
};

GlobalPixel pixel_from_mercator(MercatorXY point, int zoom) {
  const double pixel_m = mercator_pixel_m(zoom);
  return {(point.x_m + kMercatorHalfWorld_m) / pixel_m, (kMercatorHalfWorld_m - point.y_m) / pixel_m};
}

PixelBox box_of(const std::vector<MercatorXY>& outline, int zoom) {
  PixelBox box;
  for (const MercatorXY& point : outline) box.add(pixel_from_mercator(point, zoom));
  return box;
}

double great_circle_m(LonLat a, LonLat b) {
  constexpr double kMeanRadius_m = 6'371'000;
  const double lat = radians(b.lat_deg - a.lat_deg) / 2, lon = radians(b.lon_deg - a.lon_deg) / 2;
  const double h = std::sin(lat) * std::sin(lat) +
                   std::cos(radians(a.lat_deg)) * std::cos(radians(b.lat_deg)) * std::sin(lon) * std::sin(lon);
  return 2 * kMeanRadius_m * std::asin(std::min(1.0, std::sqrt(h)));
}

// Whether the line from a to b comes into the box (Liang and Barsky 1984).
bool crosses(GlobalPixel a, GlobalPixel b, const PixelBox& box) {
  double begin = 0, end = 1;
  const auto clip = [&](double from, double step, double low, double high) {
    if (step == 0) return from >= low && from <= high;
    const double enter = (low - from) / step, leave = (high - from) / step;
    begin = std::max(begin, std::min(enter, leave)), end = std::min(end, std::max(enter, leave));
    return begin <= end;
  };
  return clip(a.x, b.x - a.x, box.left, box.right) && clip(a.y, b.y - a.y, box.top, box.bottom);
}

// The part of the tile inside an outline that no edge of comes near it: all or nothing, as of its middle (even-odd
// rule). Of a large raster nearly every tile is such a one. None when an edge comes near.
std::optional<bool> whole_tile_inside(const std::vector<GlobalPixel>& outline, const TileKey& key) {
  constexpr double kNear_px = 2;
  const double left = static_cast<double>(key.x) * kTileSize, top = static_cast<double>(key.y) * kTileSize;
  const PixelBox box{left - kNear_px, top - kNear_px, left + kTileSize + kNear_px, top + kTileSize + kNear_px};
  const GlobalPixel middle{left + kTileSize / 2.0, top + kTileSize / 2.0};
  bool inside = false;
  for (std::size_t i = 0; i < outline.size(); ++i) {
    const GlobalPixel a = outline[i], b = outline[(i + 1) % outline.size()];
    if (crosses(a, b, box)) return std::nullopt;
    if ((a.y > middle.y) != (b.y > middle.y) && middle.x < a.x + (middle.y - a.y) / (b.y - a.y) * (b.x - a.x)) {
      inside = !inside;
    }
  }
  return inside;
}

// The part of the tile inside the outline: 256 x 256, 255 inside.
cv::Mat rasterize_outline(const std::vector<MercatorXY>& outline, const TileKey& key) {
  constexpr int kFraction_bits = 8;
  constexpr double kFar = 4.0e6;  // pixels; keeps the fixed-point numbers in range
  std::vector<cv::Point> corners;
  for (const MercatorXY& point : outline) {
    const GlobalPixel pixel = pixel_from_mercator(point, key.z);
    const auto fixed = [=](double value) {
      return static_cast<int>(std::lround(std::clamp(value, -kFar, kFar) * (1 << kFraction_bits)));
    };
    corners.emplace_back(fixed(pixel.x - static_cast<double>(key.x) * kTileSize - 0.5),
                         fixed(pixel.y - static_cast<double>(key.y) * kTileSize - 0.5));
  }
  cv::Mat inside(kTileSize, kTileSize, CV_8UC1, cv::Scalar(0));
  cv::fillPoly(inside, std::vector<std::vector<cv::Point>>{corners}, cv::Scalar(255), cv::LINE_8, kFraction_bits);
  return inside;
}

PixelBox wanted_box(const Mission& mission) {
  const int zoom = mission.zoom.max;
  const LocalFrame frame = mission_frame(mission);
  const PlaneBox bounds = required_region(mission, frame).bounds();
  PixelBox wanted;
  for (const double east : {bounds.west_m - kMargin_m, bounds.east_m + kMargin_m}) {
    for (const double north : {bounds.south_m - kMargin_m, bounds.north_m + kMargin_m}) {
      wanted.add(pixel_from_lonlat(frame.lonlat_from_plane({east, north}), zoom));
    }
  }
  return wanted;
}

// The tiles that both boxes touch.
TileRange common_range(const PixelBox& wanted, const PixelBox& imagery, int zoom) {
  const double last = std::exp2(zoom) - 1;
  const auto first_tile = [&](double a, double b) {
    return static_cast<std::int64_t>(std::clamp(std::floor(std::max(a, b) / kTileSize), 0.0, last));
  };
  const auto last_tile = [&](double a, double b) {
    return static_cast<std::int64_t>(std::clamp(std::ceil(std::min(a, b) / kTileSize) - 1, 0.0, last));
  };
  if (!imagery.meets(wanted)) return {zoom, 0, 0, -1, -1};
  return {zoom, first_tile(imagery.left, wanted.left), first_tile(imagery.top, wanted.top),
          last_tile(imagery.right, wanted.right), last_tile(imagery.bottom, wanted.bottom)};
}

}  // namespace

TileRange TileRange::at_zoom(int coarser) const {
  const int steps = zoom - coarser;
  if (empty()) return {coarser, 0, 0, -1, -1};
  return {coarser, first_x >> steps, first_y >> steps, last_x >> steps, last_y >> steps};
}

TileRange wanted_range(const Mission& mission) {
  const PixelBox wanted = wanted_box(mission);
  return common_range(wanted, wanted, mission.zoom.max);
}

TileRange plan_range(const Mission& mission, std::span<const ImageryInput> inputs) {
  const int zoom = mission.zoom.max;
  const PixelBox wanted = wanted_box(mission);
  PixelBox imagery;
  for (const ImageryInput& input : inputs) {
    const PixelBox box = box_of(input.outline, zoom);
    if (!box.meets(wanted)) continue;
    imagery.add({box.left, box.top});
    imagery.add({box.right, box.bottom});
  }
  return common_range(wanted, imagery, zoom);
}

Findings check_place(const Mission& mission, std::span<const ImageryInput> inputs) {
  Findings findings;
  const LocalFrame frame = mission_frame(mission);
  const LonLat middle = frame.lonlat_from_plane(required_region(mission, frame).bounds().middle());
  LonLatBox covered{180, 90, -180, -90};
  double nearest_m = INFINITY, exchanged_m = INFINITY;
  for (const ImageryInput& input : inputs) {
    LonLatBox box{180, 90, -180, -90};
    for (const MercatorXY& point : input.outline) {
      const LonLat at = lonlat_from_mercator(point);
      box.west_deg = std::min(box.west_deg, at.lon_deg), box.east_deg = std::max(box.east_deg, at.lon_deg);
      box.south_deg = std::min(box.south_deg, at.lat_deg), box.north_deg = std::max(box.north_deg, at.lat_deg);
    }
    const auto away_m = [&](LonLat from) {
      const LonLat nearest{std::clamp(from.lon_deg, box.west_deg, box.east_deg),
                           std::clamp(from.lat_deg, box.south_deg, box.north_deg)};
      return great_circle_m(from, nearest);
    };
    nearest_m = std::min(nearest_m, away_m(middle));
    exchanged_m = std::min(exchanged_m, away_m({middle.lat_deg, middle.lon_deg}));
    covered.west_deg = std::min(covered.west_deg, box.west_deg),
    covered.east_deg = std::max(covered.east_deg, box.east_deg);
    covered.south_deg = std::min(covered.south_deg, box.south_deg);
    covered.north_deg = std::max(covered.north_deg, box.north_deg);
  }
  if (inputs.empty() || nearest_m < kMargin_m) return findings;
  const bool swapped = exchanged_m < nearest_m / 10 && std::abs(middle.lon_deg) <= 90;
  findings.add(
      {.code = "coverage.elsewhere",
       .where = fmt::format("the mission, near {:.5f},{:.5f}", middle.lon_deg, middle.lat_deg),
       .expected = fmt::format("imagery of this place; it covers {:.5f},{:.5f} to {:.5f},{:.5f}", covered.west_deg,
                               covered.south_deg, covered.east_deg, covered.north_deg),
       .found = fmt::format("the mission lies {:.0f} km away{}", nearest_m / 1000,
                            swapped ? ": latitude and longitude swapped?" : ""),
       .fix = swapped
                  ? "write longitude first, then latitude; `mission import --latitude-first` reads a swapped drawing"
                  : "give the imagery of the mission's area"});
  return findings;
}

std::vector<Sidecar> plan_sidecars(const Mission& mission, std::span<const ImageryInput> inputs,
                                   const TileRange& range) {
  const LocalFrame frame = mission_frame(mission);
  std::vector<Sidecar> sidecars;
  for (int zoom = mission.zoom.min; zoom <= mission.zoom.max; ++zoom) {
    const TileRange level = range.at_zoom(zoom);
    std::vector<std::vector<GlobalPixel>> outlines;
    for (const ImageryInput& input : inputs) {
      std::vector<GlobalPixel>& outline = outlines.emplace_back();
      for (const MercatorXY& point : input.outline) outline.push_back(pixel_from_mercator(point, zoom));
    }
    for (const TileKey& key : required_tiles(mission, zoom)) {
      if (!level.contains(key)) continue;
      Sidecar sidecar;
      sidecar.key = key;
      InputShares used;
      cv::Mat valid(kTileSize, kTileSize, CV_8UC1, cv::Scalar(0));
      int count = 0;
      const cv::Rect pixels(static_cast<int>(key.x) * kTileSize, static_cast<int>(key.y) * kTileSize, kTileSize,
                            kTileSize);
      for (std::size_t i = 0; i < inputs.size() && count < kTilePixels; ++i) {
        if (!lies_near(inputs[i], zoom, pixels)) continue;  // of thousands of rasters few do
        if (const auto whole = whole_tile_inside(outlines[i], key); !whole) {
          valid |= rasterize_outline(inputs[i].outline, key);
        } else if (*whole) {
          valid.setTo(255);
        }
        const int now = cv::countNonZero(valid);
        if (now > count) used[i] = static_cast<std::uint64_t>(now - count);
        count = now;
      }
      if (count == 0) continue;
      set_facts(sidecar, inputs, used);
      sidecar.valid_ppm = kWholeTile_ppm * count / kTilePixels;
      if (count < kTilePixels) sidecar.mask = encode_image(valid, ImageFormat::png);
      if (const Sector* sector = governing_sector(mission, frame, key); sector != nullptr) sidecar.sector = sector->id;
      sidecars.push_back(std::move(sidecar));
    }
  }
  return sidecars;
}

namespace {

constexpr int kMetatileSteps = 3;  // 8 x 8 tiles: 2048 pixels a side, 16 MiB

std::uint64_t morton_code(const TileKey& key) {
  std::uint64_t code = 0;
  for (unsigned bit = 0; bit < kMaxZoom; ++bit) {
    code |= (std::uint64_t{(key.x >> bit) & 1U} << (2 * bit)) | (std::uint64_t{(key.y >> bit) & 1U} << (2 * bit + 1));
  }
  return code;
}

// Everything within margin_m of the region.
Region buffered(Region region, double margin_m) {
  for (Corridor& corridor : region.corridors) corridor.half_width_m += margin_m;
  for (const PlaneRing& ring : region.rings) {
    Corridor rim{ring, margin_m};
    rim.path.push_back(ring.front());
    region.corridors.push_back(std::move(rim));
  }
  return region;
}

}  // namespace

std::vector<TileKey> metatiles_of(const Mission& mission, const TileRange& range) {
  const TileRange tops = range.at_zoom(std::max(mission.zoom.min, range.zoom - kMetatileSteps));
  const LocalFrame frame = mission_frame(mission);
  const CoverageRequirement near_by(buffered(required_region(mission, frame), kMargin_m));
  std::vector<TileKey> keys = tiles_of_region(near_by, frame, tops.zoom);
  std::erase_if(keys, [&](const TileKey& key) { return !tops.contains(key); });
  std::sort(keys.begin(), keys.end(),
            [](const TileKey& a, const TileKey& b) { return morton_code(a) < morton_code(b); });
  return keys;
}

std::vector<ZoomCount> count_tiles(std::span<const TileKey> metatiles, const TileRange& range, int min_zoom) {
  std::vector<ZoomCount> counts;
  if (metatiles.empty()) return counts;
  const int top = metatiles.front().z;
  for (int zoom = range.zoom; zoom >= top; --zoom) {
    const TileRange level = range.at_zoom(zoom);
    const int steps = zoom - top;
    ZoomCount count{zoom, 0};
    for (const TileKey& key : metatiles) {
      const auto overlap = [steps](std::uint32_t at, std::int64_t first, std::int64_t last) {
        const std::int64_t begin = std::int64_t{at} << steps, end = begin + (std::int64_t{1} << steps) - 1;
        return static_cast<std::uint64_t>(std::max<std::int64_t>(0, std::min(end, last) - std::max(begin, first) + 1));
      };
      count.tiles += overlap(key.x, level.first_x, level.last_x) * overlap(key.y, level.first_y, level.last_y);
    }
    counts.push_back(count);
  }
  std::set<TileKey> level(metatiles.begin(), metatiles.end());
  for (int zoom = top - 1; zoom >= min_zoom; --zoom) {
    std::set<TileKey> parents;
    for (const TileKey& key : level) parents.insert(key.parent());
    level = std::move(parents);
    counts.push_back({zoom, level.size()});
  }
  std::reverse(counts.begin(), counts.end());
  return counts;
}

std::vector<ZoomCount> count_whole_build(const Mission& mission) {
  const TileRange range = wanted_range(mission);
  return count_tiles(metatiles_of(mission, range), range, mission.zoom.min);
}

}  // namespace nadir
