#include "package_build/tile_plan.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "geodesy/angles.hpp"
#include "imagery/codecs.hpp"
#include "package/mission_check.hpp"

namespace nadir {
namespace {

constexpr double kHalfWorld_m = kPi * kMercatorRadius_m;

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
  return {(point.x_m + kHalfWorld_m) / pixel_m, (kHalfWorld_m - point.y_m) / pixel_m};
}

PixelBox box_of(const std::vector<MercatorXY>& outline, int zoom) {
  PixelBox box;
  for (const MercatorXY& point : outline) box.add(pixel_from_mercator(point, zoom));
  return box;
}

// What of the tile lies inside the outline: 256 x 256, 255 inside.
cv::Mat inside_of(const std::vector<MercatorXY>& outline, const TileKey& key) {
  constexpr int kShift = 8;
  constexpr double kFar = 4.0e6;  // pixels; keeps the fixed-point numbers in range
  std::vector<cv::Point> corners;
  for (const MercatorXY& point : outline) {
    const GlobalPixel pixel = pixel_from_mercator(point, key.z);
    const auto fixed = [=](double value) {
      return static_cast<int>(std::lround(std::clamp(value, -kFar, kFar) * (1 << kShift)));
    };
    corners.emplace_back(fixed(pixel.x - static_cast<double>(key.x) * kTileSize - 0.5),
                         fixed(pixel.y - static_cast<double>(key.y) * kTileSize - 0.5));
  }
  cv::Mat inside(kTileSize, kTileSize, CV_8UC1, cv::Scalar(0));
  cv::fillPoly(inside, std::vector<std::vector<cv::Point>>{corners}, cv::Scalar(255), cv::LINE_8, kShift);
  return inside;
}

PixelBox wanted_box(const Mission& mission) {
  const int zoom = mission.zoom.max;
  const LocalFrame frame = mission_frame(mission);
  const PlaneBox bounds = required_region(mission, frame).bounds();
  PixelBox wanted;
  for (const double east : {bounds.west_m - kMargin_m, bounds.east_m + kMargin_m}) {
    for (const double north : {bounds.south_m - kMargin_m, bounds.north_m + kMargin_m}) {
      wanted.add(pixel_from_lonlat(frame.lonlat_from_enu(east, north), zoom));
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

std::vector<Sidecar> plan_sidecars(const Mission& mission, std::span<const ImageryInput> inputs,
                                   const TileRange& range) {
  const LocalFrame frame = mission_frame(mission);
  std::vector<Sidecar> sidecars;
  for (int zoom = mission.zoom.min; zoom <= mission.zoom.max; ++zoom) {
    const TileRange level = range.at_zoom(zoom);
    for (const TileKey& key : required_tiles(mission, zoom)) {
      if (!level.contains(key)) continue;
      Sidecar sidecar;
      sidecar.key = key;
      InputShares used;
      cv::Mat valid(kTileSize, kTileSize, CV_8UC1, cv::Scalar(0));
      int count = 0;
      for (std::size_t i = 0; i < inputs.size() && count < kTilePixels; ++i) {
        valid |= inside_of(inputs[i].outline, key);
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

}  // namespace nadir
