#include "vision/rectification.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <utility>
#include <vector>

#include "vision/area_resize.hpp"

namespace nadir {
namespace {

// Projects the nodes of a coarse grid exactly and interpolates the pixels between.
cv::Mat frame_pixels_of(const ReducedFrame& frame, const CameraPose& pose, const GroundGrid& grid,
                        const GroundSurface& surface) {
  const double foot_m = surface.height_m(pose.position);
  const int node_columns = nodes_along(grid.columns, kRectifyNodeStep_px),
            node_rows = nodes_along(grid.rows, kRectifyNodeStep_px);
  const Eigen::Matrix3d camera_from_enu = enu_from_camera(pose.attitude).transpose();
  cv::Mat nodes(node_rows, node_columns, CV_32FC2);
  for (int r = 0; r < node_rows; ++r) {
    for (int c = 0; c < node_columns; ++c) {
      const PlanePoint ground = grid.plane_from_pixel(c * kRectifyNodeStep_px + 0.5, r * kRectifyNodeStep_px + 0.5);
      const Eigen::Vector3d point = camera_from_enu * Eigen::Vector3d(ground.east_m - pose.position.east_m,
                                                                      ground.north_m - pose.position.north_m,
                                                                      surface.height_m(ground) - foot_m - pose.agl_m);
      Eigen::Vector2d pixel(-10000, -10000);  // outside of every frame
      if (point.z() > kMinGroundRayDown * point.norm()) pixel = frame.camera.pixel_from_point(point);
      nodes.at<cv::Vec2f>(r, c) = {static_cast<float>(pixel.x()), static_cast<float>(pixel.y())};
    }
  }
  cv::Mat pixels(grid.rows, grid.columns, CV_32FC2);
  fill_between_nodes(nodes, kRectifyNodeStep_px, pixels);
  return pixels;
}

}  // namespace

double gsd_at(const CameraModel& camera, double agl_m) { return 2 * agl_m / (camera.fx + camera.fy); }

double footprint_side_m(const CameraModel& camera, double agl_m) {
  return gsd_at(camera, agl_m) * std::max(camera.width, camera.height);
}

ReducedFrame reduce_frame(const cv::Mat& image, const CameraModel& camera, double agl_m, double gsd_m) {
  const double factor = std::min(1.0, kReducedOversampling * gsd_at(camera, agl_m) / gsd_m);
  if (factor > kWorthReducing) return {image, camera};
  const CameraModel reduced = camera.scaled(factor);
  return {area_resized(image, {reduced.width, reduced.height}), reduced};
}

Eigen::Vector3d camera_from_ground(const CameraPose& pose, PlanePoint ground, const GroundSurface& surface) {
  const double height_m = surface.height_m(ground) - surface.height_m(pose.position);
  return enu_from_camera(pose.attitude).transpose() * Eigen::Vector3d(ground.east_m - pose.position.east_m,
                                                                      ground.north_m - pose.position.north_m,
                                                                      height_m - pose.agl_m);
}

std::optional<PlanePoint> ground_from_ray(const CameraPose& pose, const Eigen::Vector3d& ray,
                                          const GroundSurface& surface) {
  const Eigen::Vector3d direction = enu_from_camera(pose.attitude) * ray.normalized();
  if (direction.z() > -kMinGroundRayDown) return std::nullopt;
  const double foot_m = surface.height_m(pose.position);
  PlanePoint ground = pose.position;
  for (int i = 0; i < kTerrainIterations; ++i) {
    const double along = (pose.agl_m + foot_m - surface.height_m(ground)) / -direction.z();
    const PlanePoint next = pose.position + along * direction.head<2>();
    const double moved_m = distance_m(next, ground);
    ground = next;
    if (i > 0 && moved_m < kTerrainConverged_m) break;
  }
  return ground;
}

std::optional<PlanePoint> sloping_ground_from_ray(const CameraPose& pose, const Eigen::Matrix3d& enu_from_camera,
                                                  const Eigen::Vector3d& ray, const Eigen::Vector2d& slope,
                                                  double height_m) {
  const Eigen::Vector3d direction = enu_from_camera * ray;
  const double down = -direction.z() + slope.dot(direction.head<2>());
  if (down < kMinSolverRayDown * direction.norm()) return std::nullopt;
  const double along = (pose.agl_m - height_m) / down;
  return pose.position + along * direction.head<2>();
}

std::optional<PlaneBox> footprint_of(const CameraModel& camera, const CameraPose& pose) {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  PlaneBox box{infinity, infinity, -infinity, -infinity};
  const double right = camera.width - 1.0, bottom = camera.height - 1.0;
  for (const auto& [x, y] : {std::pair{0.0, 0.0},
                             {right / 2, 0.0},
                             {right, 0.0},
                             {right, bottom / 2},
                             {right, bottom},
                             {right / 2, bottom},
                             {0.0, bottom},
                             {0.0, bottom / 2}}) {
    const auto ground = ground_from_ray(pose, camera.ray_from_pixel({x, y}));
    if (!ground) return std::nullopt;
    box.west_m = std::min(box.west_m, ground->east_m);
    box.east_m = std::max(box.east_m, ground->east_m);
    box.south_m = std::min(box.south_m, ground->north_m);
    box.north_m = std::max(box.north_m, ground->north_m);
  }
  return box;
}

RectifiedFrame rectify(const ReducedFrame& frame, const CameraPose& pose, const GroundGrid& grid,
                       const GroundSurface& surface) {
  const cv::Mat pixels = frame_pixels_of(frame, pose, grid, surface);
  RectifiedFrame result;
  result.grid = grid;
  cv::remap(frame.image, result.image, pixels, cv::noArray(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  result.mask.create(grid.rows, grid.columns, CV_8UC1);
  const auto right = static_cast<float>(frame.camera.width - 1), bottom = static_cast<float>(frame.camera.height - 1);
  for (int r = 0; r < grid.rows; ++r) {
    const auto* pixel = pixels.ptr<float>(r);
    auto* mask = result.mask.ptr<std::uint8_t>(r);
    for (std::size_t c = 0; c < static_cast<std::size_t>(grid.columns); ++c) {
      const float x = pixel[2 * c], y = pixel[2 * c + 1];
      mask[c] = (x >= 0) & (y >= 0) & (x <= right) & (y <= bottom) ? 255 : 0;  // without branches
    }
  }
  return result;
}

void fill_between_nodes(const cv::Mat& nodes, int step, cv::Mat& pixels) {
  const auto columns = static_cast<std::size_t>(pixels.cols), apart = static_cast<std::size_t>(step);
  // Each row of nodes is filled along once, and serves the pixels above and below.
  const auto along = [&](int node_row, std::vector<float>& filled) {
    const auto* node = nodes.ptr<cv::Vec2f>(node_row);
    for (std::size_t begin = 0; begin < columns; begin += apart, ++node) {
      const cv::Vec2f left = node[0], right = node[1];
      for (std::size_t c = begin; c < std::min(columns, begin + apart); ++c) {
        const float u = static_cast<float>(c - begin) / static_cast<float>(apart);
        filled[2 * c] = (1 - u) * left[0] + u * right[0];
        filled[2 * c + 1] = (1 - u) * left[1] + u * right[1];
      }
    }
  };
  std::vector<float> above(2 * columns), below(2 * columns);
  for (int r = 0; r < pixels.rows; ++r) {
    if (r % step == 0) {
      if (r > 0) {
        std::swap(above, below);
      } else {
        along(0, above);
      }
      along(r / step + 1, below);
    }
    const float v = static_cast<float>(r % step) / static_cast<float>(step);
    auto* row = pixels.ptr<float>(r);
    for (std::size_t i = 0; i < 2 * columns; ++i) row[i] = (1 - v) * above[i] + v * below[i];
  }
}

}  // namespace nadir
