// Camera calibration: focal lengths, principal point and distortion from images of a checkerboard (Zhang 2000, as
// OpenCV's calibrateCamera does it), and whether the views are sufficient: a fit with a small residual can still be
// wrong when the board was always in the middle, or never tilted.
//
// An unusable image is rejected with its reason: board incomplete, damaged, blurred. An image of another size than the
// first is an Error, because it is from another camera or mode.
#pragma once

#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.hpp"
#include "base/progress.hpp"
#include "vision/camera.hpp"

namespace nadir {

struct Board {
  int columns = 0;  // inner corners, where four squares meet
  int rows = 0;
  double square_m = 0;
};

// "9x6". Throws UsageError unless both are from 3 to 50 and one is odd, the other even: otherwise the board
// looks the same when it is turned by 180 degrees.
Board parse_board(std::string_view text, double square_m);

struct BoardView {
  std::string image;
  std::vector<cv::Point2f> corners{};  // pixels, row by row
  double edge_width_px = 0;            // from dark to bright, 10 % to 90 %: a sharp image has 1 to 3
};

struct RejectedImage {
  std::string image;
  std::string reason;
};

struct BoardImages {
  cv::Size size;
  std::vector<BoardView> views{};
  std::vector<RejectedImage> rejected{};
};

// Edges wider than this are blurred: the lens out of focus, or the board in motion.
inline constexpr double kMaxEdgeWidth_px = 5;

// The corners in one grey image; nullopt when the board is not completely visible.
std::optional<BoardView> find_board(const cv::Mat& grey, const Board& board, std::string image);

// All JPEG and PNG files of the folder, by name. Throws UsageError when there are none.
BoardImages find_boards(const std::filesystem::path& folder, const Board& board, Progress& progress);

struct CalibrationLimits {
  int min_views = 8;
  double max_residual_px = 0.5;    // root mean square over all corners
  double min_coverage = 0.6;       // of the image's width and of its height, between the outermost corners
  double min_tilt_rad = 0.35;      // between two boards: parallel ones do not separate focal length from distance
  double max_focal_sigma = 0.002;  // of the focal lengths, relative, by the fit
};

struct Calibration {
  CameraModel camera;
  double residual_px = 0;
  std::vector<double> view_residual_px;  // in the order of the views
  double worst_view_px = 0;
  std::string worst_view;
  double focal_sigma = 0;  // relative
  double tilt_rad = 0;     // the largest angle between two boards
  double coverage_across = 0;
  double coverage_down = 0;
};

// Throws Error when there are fewer than three views, or the fit does not converge.
Calibration calibrate(const BoardImages& images, const Board& board);

// provision.few_pictures, provision.coverage: known before the fit.
Findings check_views(const BoardImages& images, const CalibrationLimits& limits);

// provision.residual, provision.tilt, provision.focal_length, provision.lens: known from the fit.
Findings check_calibration(const Calibration& calibration, const CalibrationLimits& limits);

// camera.yaml (docs/formats.md).
std::string camera_yaml(const CameraModel& camera);

}  // namespace nadir
