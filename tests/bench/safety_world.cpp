#include "safety_world.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "base/random.hpp"
#include "estimation/localizer.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"
#include "simulation/landscape_rendering.hpp"
#include "simulation/world.hpp"

namespace nadir::bench {
namespace {

constexpr int kSide_px = static_cast<int>(kWorldSide_m / kWorldGsd_m);
constexpr double kPiece_m = 110;  // of what changed between two years

cv::Mat picture_of(const Landscape& land, View view) {
  const Painter painter(land, view == View::day ? Season::september : Season::may);
  return render_view(land, painter, view, {kWorldGsd_m, land.size_m, 0, 0, kSide_px, kSide_px});
}

GroundPoint spot_of(PlanePoint place) { return {place.east_m + kWorldSide_m / 2, place.north_m + kWorldSide_m / 2}; }

}  // namespace

const LocalFrame& frame() {
  static const LocalFrame local({13.4, 48.7});
  return local;
}

cv::Point2d pixel_of(PlanePoint place, cv::Size size, double gsd_m) {
  const double width_m = size.width * gsd_m, height_m = size.height * gsd_m;
  return {(place.east_m + width_m / 2) / gsd_m - 0.5, (height_m - (place.north_m + height_m / 2)) / gsd_m - 0.5};
}

cv::Point2d pixel_of(PlanePoint place) { return pixel_of(place, {kSide_px, kSide_px}, kWorldGsd_m); }

Terrain::Terrain(const Relief& relief) : relief_(relief), level_m_(relief.at(spot_of({}))) {}

double Terrain::height_m(PlanePoint point) const { return relief_.at(spot_of(point)) - level_m_; }

TileKey tile_under(PlanePoint place) { return tile_at(frame().lonlat_from_plane(place), kMapZoom); }

bool Border::beyond(const TileKey& key) const {
  const LonLat middle = lonlat_from_pixel(
      {(static_cast<double>(key.x) + 0.5) * kTileSize, (static_cast<double>(key.y) + 0.5) * kTileSize}, key.z);
  const PlanePoint place = frame().plane_from_lonlat(middle);
  return beyond(place);
}

std::optional<Bytes> PictureTiles::read(const TileKey& key) const {
  {
    const std::lock_guard lock(mutex_);
    const auto known = known_.find(key);
    if (known != known_.end()) return known->second;
  }
  auto tile = cut(key);
  const std::lock_guard lock(mutex_);
  return known_.emplace(key, std::move(tile)).first->second;
}

std::optional<Bytes> PictureTiles::cut(const TileKey& key) const {
  if (key.z != zooms().max) return std::nullopt;
  const auto source = [&](int column, int row) {
    const PlanePoint at = frame().plane_from_lonlat(lonlat_from_pixel(
        {static_cast<double>(key.x) * kTileSize + column, static_cast<double>(key.y) * kTileSize + row}, key.z));
    PlanePoint place{at.east_m - placement_.shift.east_m, at.north_m - placement_.shift.north_m};
    if (placement_.orientation == MapOrientation::mirrored) place.east_m = -place.east_m;
    if (placement_.orientation == MapOrientation::quarter_turn) place = {place.north_m, -place.east_m};
    return cv::Point2f(pixel_of(place, picture_.size(), placement_.gsd_m));
  };
  // Within a tile the plane is practically affine. Pixel centres lie half a pixel inside of the corners.
  const cv::Point2f from[] = {source(0, 0), source(kTileSize, 0), source(0, kTileSize)};
  const cv::Point2f to[] = {{-0.5F, -0.5F}, {kTileSize - 0.5F, -0.5F}, {-0.5F, kTileSize - 0.5F}};
  const cv::Point2f far = from[1] + from[2] - from[0];
  const cv::Rect2f inside(0, 0, static_cast<float>(picture_.cols - 1), static_cast<float>(picture_.rows - 1));
  if (!inside.contains(from[0]) || !inside.contains(from[1]) || !inside.contains(from[2]) || !inside.contains(far)) {
    return std::nullopt;
  }
  cv::Mat tile;
  cv::warpAffine(picture_, tile, cv::getAffineTransform(to, from), {kTileSize, kTileSize},
                 cv::INTER_LINEAR | cv::WARP_INVERSE_MAP);
  return encode_image(tile, ImageFormat::jpeg, 80);
}

World::World(std::uint64_t seed)
    : land(generate_landscape(seed, kWorldSide_m)),
      day(picture_of(land, View::day)),
      satellite(picture_of(land, View::satellite)),
      terrain(land.relief),
      map_sigma_m(map_sigma_from_ce90(map_ce90_m(land))),
      map(satellite),
      mirrored_map(satellite, {.orientation = MapOrientation::mirrored}) {}

cv::Mat outdated(const World& world, const World& donor, std::uint64_t seed) {
  Random random(seed);
  cv::Mat mask(world.satellite.size(), CV_8UC1, cv::Scalar(0));
  while (cv::countNonZero(mask) < 0.5 * static_cast<double>(mask.total())) {
    const auto along = [&](double low, double high) {
      return static_cast<float>(random.uniform(low, high) * kPiece_m / kWorldGsd_m);
    };
    const cv::RotatedRect piece(
        {static_cast<float>(random.uniform(0, mask.cols)), static_cast<float>(random.uniform(0, mask.rows))},
        {along(0.4, 1.6), along(0.4, 1.6)}, static_cast<float>(random.uniform(0, 180)));
    cv::ellipse(mask, piece, cv::Scalar(255), cv::FILLED);
  }
  cv::Mat result = world.satellite.clone();
  donor.satellite.copyTo(result, mask);
  return result;
}

std::uint64_t first_world_of(std::uint64_t base_seed) {
  constexpr std::uint64_t kJudging = 1'000'000;
  return base_seed >= kJudging ? kJudging + 1 : 1;
}

Worlds::Worlds(int count, std::uint64_t first_seed) {
  for (int i = 0; i < count; ++i) {
    all.push_back(std::make_unique<World>(first_seed + static_cast<std::uint64_t>(i)));
  }
  for (std::size_t i = 0; i < all.size(); ++i) old_pictures.push_back(outdated(*all[i], neighbour(i), i));
  for (const cv::Mat& picture : old_pictures) old_maps.push_back(std::make_unique<PictureTiles>(picture));
}

}  // namespace nadir::bench
