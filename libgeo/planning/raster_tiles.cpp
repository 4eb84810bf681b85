#include "planning/raster_tiles.hpp"

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "imagery/codecs.hpp"

namespace nadir {
namespace {

constexpr std::size_t kKeptTiles = 1000;  // some 20 MB
constexpr int kFinestZoom = 22;
constexpr int kZoomsAbove = 9;  // further out a raster is a dot
constexpr int kTileQuality = 80;

LonLatBox box_of(const std::vector<MercatorXY>& outline) {
  LonLatBox box{180, 90, -180, -90};
  for (const MercatorXY& point : outline) {
    const LonLat place = lonlat_from_mercator(point);
    box.west_deg = std::min(box.west_deg, place.lon_deg), box.east_deg = std::max(box.east_deg, place.lon_deg);
    box.south_deg = std::min(box.south_deg, place.lat_deg), box.north_deg = std::max(box.north_deg, place.lat_deg);
  }
  return box;
}

// The first zoom as fine as the raster.
int finest_zoom(double pixel_m, double lat_deg) {
  int zoom = 0;
  while (zoom < kFinestZoom && ground_resolution_m(zoom, lat_deg) > pixel_m) ++zoom;
  return zoom;
}

}  // namespace

RasterTiles::RasterTiles(const std::filesystem::path& path) : raster_(path), bounds_(box_of(raster_.outline())) {
  zooms_.max = finest_zoom(raster_.pixel_m(), (bounds_.south_deg + bounds_.north_deg) / 2);
  zooms_.min = std::max(0, zooms_.max - kZoomsAbove);
}

std::optional<Bytes> RasterTiles::read(const TileKey& key) const {
  const std::lock_guard lock(mutex_);
  if (const auto found = places_.find(key); found != places_.end()) {
    kept_.splice(kept_.begin(), kept_, found->second);
    return found->second->second;
  }
  kept_.emplace_front(key, made(key));
  places_[key] = kept_.begin();
  if (kept_.size() > kKeptTiles) {
    places_.erase(kept_.back().first);
    kept_.pop_back();
  }
  return kept_.front().second;
}

std::optional<Bytes> RasterTiles::made(const TileKey& key) const {
  if (!key.valid() || key.z < zooms_.min || key.z > zooms_.max) return std::nullopt;
  const LonLatBox box = bounds_of(key);
  if (box.east_deg < bounds_.west_deg || box.west_deg > bounds_.east_deg || box.north_deg < bounds_.south_deg ||
      box.south_deg > bounds_.north_deg) {
    return std::nullopt;
  }
  const MaskedImage image = raster_.read(
      key.z, {static_cast<int>(key.x) * kTileSize, static_cast<int>(key.y) * kTileSize, kTileSize, kTileSize});
  const int valid = cv::countNonZero(image.mask);
  if (valid == 0) return std::nullopt;
  if (valid == kTileSize * kTileSize) return encode_image(image.bgr, ImageFormat::jpeg, kTileQuality);
  cv::Mat with_alpha;
  cv::cvtColor(image.bgr, with_alpha, cv::COLOR_BGR2BGRA);
  cv::insertChannel(image.mask, with_alpha, 3);
  return encode_image(with_alpha, ImageFormat::webp, kTileQuality);
}

}  // namespace nadir
