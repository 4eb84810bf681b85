// A camera's focal lengths, centre and distortion from views of a checkerboard (Zhang 2000, as OpenCV's calibrateCamera
// does it), and whether the views say enough: a fit with a small residual can still be wrong when the board was always
// in the middle, or never tilted.
#pragma once

#include <string>
#include <vector>

#include "base/finding.hpp"
#include "provision/board_pictures.hpp"
#include "vision/camera.hpp"

namespace nadir {

struct CalibrationLimits {
  int min_views = 8;
  double max_residual_px = 0.5;    // root mean square over all corners
  double min_coverage = 0.6;       // of the picture's width, and of its height, between the outermost corners
  double min_tilt_rad = 0.35;      // between two boards: parallel ones do not tell focal length from distance
  double max_focal_sigma = 0.002;  // of the focal lengths, relative, as the fit says
};

struct Calibration {
  CameraModel camera;
  double residual_px = 0;
  std::vector<double> view_residual_px;  // as the views
  double worst_view_px = 0;
  std::string worst_view;
  double focal_sigma = 0;  // relative
  double tilt_rad = 0;     // the largest angle between two of the boards
  double coverage_across = 0;
  double coverage_down = 0;
};

// Throws Error when there are fewer than three views, or the fit does not converge.
Calibration calibrate(const BoardPictures& pictures, const Board& board);

// provision.few_pictures, provision.coverage: what can be said before the fit.
Findings check_views(const BoardPictures& pictures, const CalibrationLimits& limits);

// provision.residual, provision.tilt, provision.focal_length, provision.lens: what the fit itself shows.
Findings check_calibration(const Calibration& calibration, const CalibrationLimits& limits);

// camera.yaml (docs/formats.md).
std::string camera_yaml(const CameraModel& camera);

}  // namespace nadir
