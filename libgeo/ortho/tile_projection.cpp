#include "ortho/tile_projection.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "geodesy/web_mercator.hpp"
#include "vision/rectification.hpp"

namespace nadir {
namespace {

constexpr double kMinDownComponent = 0.3;  // as vision/rectify.cpp: beyond 72 degrees off nadir nothing is usable
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
  const Enu enu = frame.enu_from_lonlat(place);
  const PlanePoint point{enu.east_m, enu.north_m};
  return {point, surface.height_m(point)};
}

// From the camera to the ground, east-north-up.
Eigen::Vector3d sight_of(const CameraPose& pose, double foot_m, const GroundPoint& ground) {
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
      enu_from_camera(pose.attitude).transpose() * sight_of(pose, surface.height_m(pose.position), ground);
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
      const Eigen::Vector3d sight = sight_of(pose, foot_m, here[i]);
      const Eigen::Vector3d point = camera_from_enu * sight;
      Eigen::Vector2d pixel = Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN());
      if (point.z() > kMinDownComponent * point.norm()) pixel = camera.pixel_from_point(point);
      result.nodes.at<cv::Vec2f>(r, c) = {static_cast<float>(pixel.x()), static_cast<float>(pixel.y())};
      result.whole = result.whole && inside_frame(camera, pixel.x(), pixel.y());
      const double aside_m = sight.head<2>().norm();
      result.slants.at<float>(r, c) = sight.z() < 0 ? static_cast<float>(aside_m / -sight.z()) : NAN;
      result.view_angle_rad = std::max(result.view_angle_rad, std::atan2(aside_m, -sight.z()));
      const auto climb = [&](const GroundPoint& other) {
        const double run_m =
            std::hypot(here[i].place.east_m - other.place.east_m, here[i].place.north_m - other.place.north_m);
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
      const GlobalPixel at = pixel_from_lonlat(frame.lonlat_from_enu(ground->east_m, ground->north_m), zoom);
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

}  // namespace nadir
