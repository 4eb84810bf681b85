#include "package_build/water_mask.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"

namespace nadir {
namespace {

constexpr int kShift = 4;        // fractional bits of a corner
constexpr double kFar_px = 1e6;  // corners are clamped here, so that they fit; the shape is off only out there

cv::Point corner_of(LonLat place, const TileKey& key) {
  const GlobalPixel pixel = pixel_from_lonlat(place, key.z);
  const auto fixed = [](double value) {
    return static_cast<int>(std::lround(std::clamp(value, -kFar_px, kFar_px) * (1 << kShift)));
  };
  return {fixed(pixel.x - static_cast<double>(key.x) * kTileSize - 0.5),
          fixed(pixel.y - static_cast<double>(key.y) * kTileSize - 0.5)};
}

}  // namespace

WaterMaskedTiles::WaterMaskedTiles(const TileSource& tiles, const VectorLayer& vectors) : tiles_(tiles) {
  for (const MapVector& vector : vectors.features) {
    if (vector.cls != VectorClass::water || !vector.is_area) continue;
    Area area{&vector, {180, 90, -180, -90}};
    for (const LonLat& point : vector.parts.front()) {
      area.box.west_deg = std::min(area.box.west_deg, point.lon_deg);
      area.box.south_deg = std::min(area.box.south_deg, point.lat_deg);
      area.box.east_deg = std::max(area.box.east_deg, point.lon_deg);
      area.box.north_deg = std::max(area.box.north_deg, point.lat_deg);
    }
    areas_.push_back(area);
  }
}

std::optional<Bytes> WaterMaskedTiles::read_mask(const TileKey& key) const {
  std::optional<Bytes> known = tiles_.read_mask(key);
  const LonLatBox tile = bounds_of(key);
  cv::Mat mask;
  for (const Area& area : areas_) {
    const bool apart = area.box.east_deg < tile.west_deg || area.box.west_deg > tile.east_deg ||
                       area.box.north_deg < tile.south_deg || area.box.south_deg > tile.north_deg;
    if (apart) continue;
    if (mask.empty()) {
      mask = known ? decode_image(*known, Colour::grey, "mask of tile " + to_text(key)).image.clone()
                   : cv::Mat(kTileSize, kTileSize, CV_8UC1, cv::Scalar(255));
    }
    std::vector<std::vector<cv::Point>> rings;
    for (const std::vector<LonLat>& part : area.vector->parts) {
      std::vector<cv::Point>& ring = rings.emplace_back();
      for (const LonLat& point : part) ring.push_back(corner_of(point, key));
    }
    cv::fillPoly(mask, rings, cv::Scalar(0), cv::LINE_8, kShift);
  }
  if (mask.empty()) return known;
  return encode_image(mask, ImageFormat::png);
}

}  // namespace nadir
