#include "ortho/orthorectifier.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "geodesy/web_mercator.hpp"
#include "vision/rectification.hpp"

namespace nadir {
namespace {

constexpr double kMinDownComponent = 0.3;  // as vision/rectification.cpp: beyond 72 degrees off nadir nothing is usable
constexpr double kMargin_px = 1.0;         // at the frame's border: what the interpolation reads

struct GroundPoint {
  PlanePoint place;
  double height_m = 0;
};

GroundPoint ground_under(const TileKey& key, double column, double row, const LocalFrame& frame,
                         const GroundSurface& surface) {
  const LonLat place = lonlat_from_pixel(
      {static_cast<double>(key.x) * kTileSize + column + 0.5, static_cast<double>(key.y) * kTileSize + row + 0.5},
      key.z);
  const PlanePoint point = frame.plane_from_lonlat(place);
  return {point, surface.height_m(point)};
}

// From the camera to the ground, east-north-up.
Eigen::Vector3d line_of_sight(const CameraPose& pose, double foot_m, const GroundPoint& ground) {
  return {ground.place.east_m - pose.position.east_m, ground.place.north_m - pose.position.north_m,
          ground.height_m - foot_m - pose.agl_m};
}

}  // namespace

bool inside_frame(const CameraModel& camera, double x, double y) {
  return x >= kMargin_px && y >= kMargin_px && x <= camera.width - 1 - kMargin_px &&
         y <= camera.height - 1 - kMargin_px;
}

std::optional<Eigen::Vector2d> frame_pixel_of(const TileKey& key, double column, double row, const LocalFrame& frame,
                                              const CameraModel& camera, const CameraPose& pose,
                                              const GroundSurface& surface) {
  const GroundPoint ground = ground_under(key, column, row, frame, surface);
  const Eigen::Vector3d point =
      enu_from_camera(pose.attitude).transpose() * line_of_sight(pose, surface.height_m(pose.position), ground);
  if (!(point.z() > kMinDownComponent * point.norm())) return std::nullopt;
  return camera.pixel_from_point(point);
}

TileProjection project_tile(const TileKey& key, const LocalFrame& frame, const CameraModel& camera,
                            const CameraPose& pose, const GroundSurface& surface) {
  constexpr int kNodes = nodes_along(kTileSize, kTileNodeStep);
  const double foot_m = surface.height_m(pose.position);
  const Eigen::Matrix3d camera_from_enu = enu_from_camera(pose.attitude).transpose();
  TileProjection result;
  result.nodes.create(kNodes, kNodes, CV_32FC2);
  result.slants.create(kNodes, kNodes, CV_32FC1);
  result.whole = true;
  std::array<GroundPoint, kNodes> above{}, here{};
  for (int r = 0; r < kNodes; ++r) {
    for (int c = 0; c < kNodes; ++c) {
      const auto i = static_cast<std::size_t>(c);
      here[i] = ground_under(key, c * kTileNodeStep, r * kTileNodeStep, frame, surface);
      const Eigen::Vector3d ray = line_of_sight(pose, foot_m, here[i]);
      const Eigen::Vector3d point = camera_from_enu * ray;
      Eigen::Vector2d pixel = Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN());
      if (point.z() > kMinDownComponent * point.norm()) pixel = camera.pixel_from_point(point);
      result.nodes.at<cv::Vec2f>(r, c) = {static_cast<float>(pixel.x()), static_cast<float>(pixel.y())};
      result.whole = result.whole && inside_frame(camera, pixel.x(), pixel.y());
      const double aside_m = ray.head<2>().norm();
      result.slants.at<float>(r, c) = ray.z() < 0 ? static_cast<float>(aside_m / -ray.z()) : NAN;
      result.view_angle_rad = std::max(result.view_angle_rad, std::atan2(aside_m, -ray.z()));
      const auto climb = [&](const GroundPoint& other) {
        const double run_m = distance_m(here[i].place, other.place);
        result.slope = std::max(result.slope, std::abs(here[i].height_m - other.height_m) / run_m);
      };
      if (c > 0) climb(here[i - 1]);
      if (r > 0) climb(above[i]);
    }
    above = here;
  }
  return result;
}

std::vector<TileKey> tiles_seen(int zoom, const LocalFrame& frame, const CameraModel& camera, const CameraPose& pose,
                                const GroundSurface& surface, std::size_t most) {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  GlobalPixel least{infinity, infinity}, last{-infinity, -infinity};
  const double right = camera.width - 1.0, bottom = camera.height - 1.0;
  for (const double x : {0.0, right / 2, right}) {
    for (const double y : {0.0, bottom / 2, bottom}) {
      const auto ground = ground_from_ray(pose, camera.ray_from_pixel({x, y}), surface);
      if (!ground) return {};
      const GlobalPixel at = pixel_from_lonlat(frame.lonlat_from_plane(*ground), zoom);
      least = {std::min(least.x, at.x), std::min(least.y, at.y)};
      last = {std::max(last.x, at.x), std::max(last.y, at.y)};
    }
  }
  // Up to the tiles that the outermost corners lie in.
  const auto first_of = [](double pixel) { return std::max(0.0, std::ceil(pixel / kTileSize) - 1); };
  const double west = first_of(least.x), north = first_of(least.y);
  const double across = static_cast<double>(std::uint32_t{1} << zoom);
  const double east = std::min(std::floor(last.x / kTileSize) + 1, across);
  const double south = std::min(std::floor(last.y / kTileSize) + 1, across);
  if (!(east > west) || !(south > north) || (east - west) * (south - north) > static_cast<double>(most)) return {};
  std::vector<TileKey> keys;
  for (auto x = static_cast<std::uint32_t>(west); x < static_cast<std::uint32_t>(east); ++x) {
    for (auto y = static_cast<std::uint32_t>(north); y < static_cast<std::uint32_t>(south); ++y) {
      keys.push_back({static_cast<std::uint8_t>(zoom), x, y});
    }
  }
  return keys;
}

namespace {

constexpr double kFiner = 1.2;             // the level's pixels against the tile's, as reduce_frame() has it
constexpr std::size_t kTilesAtOnce = 100;  // OpenCV's remap takes 32767 rows

}  // namespace

std::vector<ProjectedTile> whole_tiles(int zoom, const LocalFrame& frame, const CameraModel& camera,
                                       const CameraPose& pose, const GroundSurface& surface) {
  std::vector<ProjectedTile> tiles;
  for (const TileKey& key : tiles_seen(zoom, frame, camera, pose, surface)) {
    const bool corners = [&] {
      for (const double column : {0.0, kTileSize - 1.0}) {
        for (const double row : {0.0, kTileSize - 1.0}) {
          const auto pixel = frame_pixel_of(key, column, row, frame, camera, pose, surface);
          if (!pixel || pixel->x() < 0 || pixel->y() < 0 || pixel->x() > camera.width || pixel->y() > camera.height) {
            return false;
          }
        }
      }
      return true;
    }();
    if (!corners) continue;  // most of the box around a turned frame
    TileProjection projection = project_tile(key, frame, camera, pose, surface);
    if (projection.whole) tiles.push_back({key, std::move(projection)});
  }
  return tiles;
}

std::vector<OrthoTile> orthorectify(const ReducedFrame& frame, const std::vector<ProjectedTile>& tiles) {
  std::vector<OrthoTile> result;
  for (std::size_t first = 0; first < tiles.size(); first += kTilesAtOnce) {
    const std::size_t count = std::min(kTilesAtOnce, tiles.size() - first);
    cv::Mat pixels(static_cast<int>(count) * kTileSize, kTileSize, CV_32FC2);
    const auto rows_of = [](std::size_t i) {
      return cv::Range(static_cast<int>(i) * kTileSize, static_cast<int>(i + 1) * kTileSize);
    };
    for (std::size_t i = 0; i < count; ++i) {
      cv::Mat part = pixels.rowRange(rows_of(i));
      fill_between_nodes(tiles[first + i].projection.nodes, kTileNodeStep, part);
    }
    cv::Mat image;
    cv::remap(frame.image, image, pixels, cv::noArray(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
    for (std::size_t i = 0; i < count; ++i) result.push_back({tiles[first + i].key, image.rowRange(rows_of(i))});
  }
  return result;
}

int decoding_shrink(const CameraModel& camera, double agl_m, double tile_gsd_m) {
  for (const int shrink : {8, 4, 2}) {
    const bool whole = camera.width % shrink == 0 && camera.height % shrink == 0;
    if (whole && gsd_at(camera, agl_m) * shrink * kFiner <= tile_gsd_m) return shrink;
  }
  return 1;
}

namespace {

constexpr int kMinSeen_px = 64;

cv::Mat filled_slants(const cv::Mat& nodes) {
  cv::Mat slants(kTileSize, kTileSize, CV_32FC1);
  for (int r = 0; r < kTileSize; ++r) {
    const int n = r / kTileNodeStep;
    const float v = static_cast<float>(r % kTileNodeStep) / kTileNodeStep;
    const auto *above = nodes.ptr<float>(n), *below = nodes.ptr<float>(n + 1);
    auto* row = slants.ptr<float>(r);
    for (int c = 0; c < kTileSize; ++c) {
      const int m = c / kTileNodeStep;
      const float u = static_cast<float>(c % kTileNodeStep) / kTileNodeStep;
      row[c] = (1 - v) * ((1 - u) * above[m] + u * above[m + 1]) + v * ((1 - u) * below[m] + u * below[m + 1]);
    }
  }
  return slants;
}

// pixels: of the frame; those that it does not have become ones that remap() can take.
PartialTile resample(const ReducedFrame& frame, const ProjectedTile& tile, cv::Mat& pixels, double max_view_angle_rad) {
  fill_between_nodes(tile.projection.nodes, kTileNodeStep, pixels);
  PartialTile partial;
  partial.key = tile.key;
  partial.slants = filled_slants(tile.projection.slants);
  partial.seen.create(kTileSize, kTileSize, CV_8UC1);
  const auto most = static_cast<float>(std::tan(max_view_angle_rad));
  float least = most;
  for (int r = 0; r < kTileSize; ++r) {
    auto* from = pixels.ptr<cv::Vec2f>(r);
    const auto* slant = partial.slants.ptr<float>(r);
    auto* seen = partial.seen.ptr<std::uint8_t>(r);
    for (int c = 0; c < kTileSize; ++c) {
      const bool sees = slant[c] <= most && inside_frame(frame.camera, from[c][0], from[c][1]);
      seen[c] = sees ? 255 : 0;
      if (sees) {
        ++partial.seen_px;
        least = std::min(least, slant[c]);
      } else {
        from[c] = {-1, -1};
      }
    }
  }
  partial.least_view_rad = std::atan(least);
  cv::remap(frame.image, partial.image, pixels, cv::noArray(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  return partial;
}

}  // namespace

std::vector<ProjectedTile> partial_tiles(int zoom, const LocalFrame& frame, const CameraModel& camera,
                                         const CameraPose& pose, const GroundSurface& surface) {
  constexpr double kLast = kTileSize - 1.0;
  std::vector<ProjectedTile> tiles;
  for (const TileKey& key : tiles_seen(zoom, frame, camera, pose, surface)) {
    // Many tiles of the box around a turned frame lie beside it; a thin corner that is missed here is no loss.
    const bool touched = [&] {
      for (const double column : {0.0, kLast / 4, kLast / 2, 3 * kLast / 4, kLast}) {
        for (const double row : {0.0, kLast / 4, kLast / 2, 3 * kLast / 4, kLast}) {
          const auto pixel = frame_pixel_of(key, column, row, frame, camera, pose, surface);
          if (pixel && inside_frame(camera, pixel->x(), pixel->y())) return true;
        }
      }
      return false;
    }();
    if (!touched) continue;
    TileProjection projection = project_tile(key, frame, camera, pose, surface);
    if (!projection.whole) tiles.push_back({key, std::move(projection)});
  }
  return tiles;
}

std::optional<PartialTile> cut_partial_tile(const ReducedFrame& frame, const ProjectedTile& tile,
                                            double max_view_angle_rad) {
  cv::Mat pixels(kTileSize, kTileSize, CV_32FC2);
  PartialTile partial = resample(frame, tile, pixels, max_view_angle_rad);
  return partial.seen_px >= kMinSeen_px ? std::optional(std::move(partial)) : std::nullopt;
}

}  // namespace nadir
