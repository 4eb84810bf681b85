// Nadir rectification: a frame resampled to the map's north-up grid, as if seen from straight above.
//
// Positions are metres in the map's plane (LocalFrame); heights are relative to the ground under the camera. A ground
// point at (e, n), h above the ground under the camera, lies in the frame of a camera at (e0, n0, agl) at
//   p = Rᵀ (e - e0, n - n0, h - agl),    R = enu_from_camera(attitude),
// and appears where the lens images p (camera.hpp).
#pragma once

#include <opencv2/core/mat.hpp>

#include "geodesy/region.hpp"
#include "vision/camera.hpp"
#include "vision/ground_surface.hpp"

namespace nadir {

struct CameraPose {
  PlanePoint position;  // of the camera, projected to the ground
  double agl_m = 100;   // above the ground right under the camera
  Attitude attitude;
};

// The grid of a rectified frame; pixel (c, r)'s centre as in MapWindow.
struct GroundGrid {
  double west_m = 0;
  double north_m = 0;
  double gsd_m = 1;
  int columns = 0;
  int rows = 0;

  PlanePoint plane_from_pixel(double column, double row) const {
    return {west_m + column * gsd_m, north_m - row * gsd_m};
  }
};

struct RectifiedFrame {
  cv::Mat image;  // as the frame's type
  cv::Mat mask;   // CV_8UC1: 255 where the frame shows the ground
  GroundGrid grid;
};

// A frame reduced so that its pixels are not much finer than the grid that it will be resampled to.
struct ReducedFrame {
  cv::Mat image;
  CameraModel camera;  // of the reduced image
};
ReducedFrame reduce_frame(const cv::Mat& image, const CameraModel& camera, double agl_m, double gsd_m);

// The flat ground that the camera sees, as a box in the plane; nothing when a corner's ray is too close to the horizon.
std::optional<PlaneBox> footprint_of(const CameraModel& camera, const CameraPose& pose);

// Ground size of a pixel under the camera.
double gsd_at(const CameraModel& camera, double agl_m);
// The longer side of the ground that the camera sees from this height.
double footprint_side_m(const CameraModel& camera, double agl_m);

RectifiedFrame rectify(const ReducedFrame& frame, const CameraPose& pose, const GroundGrid& grid,
                       const GroundSurface& surface = FlatGround());

// A ground point in the camera frame, and the ground point that a ray meets (nothing at or above the horizon).
Eigen::Vector3d camera_from_ground(const CameraPose& pose, PlanePoint ground,
                                   const GroundSurface& surface = FlatGround());
std::optional<PlanePoint> ground_from_ray(const CameraPose& pose, const Eigen::Vector3d& ray,
                                          const GroundSurface& surface = FlatGround());

// Where a ray meets a plane that slopes through the ground under the camera and lies `height_m` above it there; slope:
// rise over run to the east and to the north. enu_from_camera: of the pose's attitude. Nothing near the horizon. This
// is the measurement model of the pose solvers.
std::optional<Eigen::Vector2d> sloping_ground_from_ray(const CameraPose& pose, const Eigen::Matrix3d& enu_from_camera,
                                                       const Eigen::Vector3d& ray, const Eigen::Vector2d& slope,
                                                       double height_m = 0);

// Image coordinates that are computed exactly at the nodes of a coarse grid and interpolated between them: for
// perspective and lens a small fraction of a pixel off, and ten times as fast.
//
// How many nodes stand along so many pixels: the last one lies at the last pixel or beyond.
constexpr int nodes_along(int pixels, int step) { return (pixels + step - 1) / step + 1; }
// nodes: CV_32FC2, node (c, r) being that of pixel (c · step, r · step). The result, CV_32FC2 of the given size, is
// written to `pixels`, which may be a part of a larger image. Bilinear.
void fill_between_nodes(const cv::Mat& nodes, int step, cv::Mat& pixels);

}  // namespace nadir
