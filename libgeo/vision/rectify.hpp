// Nadir rectification: a frame resampled to the map's north-up grid, as if seen from straight above.
//
// Positions are metres in the map's plane (LocalFrame); heights are relative to the ground under the camera.
#pragma once

#include <opencv2/core/mat.hpp>

#include "geodesy/region.hpp"
#include "vision/camera_model.hpp"
#include "vision/ground_surface.hpp"

namespace nadir {

struct CameraPose {
  PlanePoint position;  // of the camera, projected to the ground
  double agl_m = 100;   // above the ground right under the camera
  Attitude attitude;
};

// The grid of a rectified picture; pixel (c, r)'s centre as in MapWindow.
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
  cv::Mat mask;   // CV_8UC1: 255 where the frame saw the ground
  GroundGrid grid;
};

// A frame reduced so that its pixels are not much finer than the grid that it will be resampled to.
struct ReducedFrame {
  cv::Mat image;
  CameraModel camera;  // of the reduced image
};
ReducedFrame reduce_frame(const cv::Mat& image, const CameraModel& camera, double agl_m, double gsd_m);

// The ground that the camera sees, as a box in the plane; nothing when a corner looks above `max_obliquity` from nadir.
std::optional<PlaneBox> footprint_of(const CameraModel& camera, const CameraPose& pose);  // on flat ground

// Ground size of a pixel under the camera.
double gsd_at(const CameraModel& camera, double agl_m);
// The longer side of the ground that the camera sees from this height.
double footprint_side_m(const CameraModel& camera, double agl_m);

RectifiedFrame rectify(const ReducedFrame& frame, const CameraPose& pose, const GroundGrid& grid,
                       const GroundSurface& surface = FlatGround());

// Where the camera sees a ground point, and the ground point that a pixel sees (nothing at or above the horizon).
Eigen::Vector3d camera_from_ground(const CameraPose& pose, PlanePoint ground,
                                   const GroundSurface& surface = FlatGround());
std::optional<PlanePoint> ground_from_ray(const CameraPose& pose, const Eigen::Vector3d& ray,
                                          const GroundSurface& surface = FlatGround());

}  // namespace nadir
