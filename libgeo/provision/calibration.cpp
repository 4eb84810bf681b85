#include "provision/calibration.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <tuple>
#include <utility>

#include "base/error.hpp"
#include "base/yaml.hpp"
#include "geodesy/angles.hpp"
#include "vision/camera.hpp"

namespace nadir {
namespace {

constexpr std::size_t kViewsForAFit = 3;

std::vector<cv::Point3f> corners_of(const Board& board) {
  std::vector<cv::Point3f> corners;
  for (int row = 0; row < board.rows; ++row) {
    for (int column = 0; column < board.columns; ++column) {
      corners.emplace_back(static_cast<float>(column * board.square_m), static_cast<float>(row * board.square_m), 0.0F);
    }
  }
  return corners;
}

// Of the picture's width and height, what lies between the outermost corners of all views.
std::pair<double, double> coverage(const BoardPictures& pictures) {
  std::vector<cv::Point2f> all;
  for (const BoardView& view : pictures.views) all.insert(all.end(), view.corners.begin(), view.corners.end());
  if (all.empty()) return {0, 0};
  const auto [left, right] = std::ranges::minmax(all, {}, &cv::Point2f::x);
  const auto [top, bottom] = std::ranges::minmax(all, {}, &cv::Point2f::y);
  return {static_cast<double>(right.x - left.x) / pictures.size.width,
          static_cast<double>(bottom.y - top.y) / pictures.size.height};
}

// The largest angle between two of the boards' normals.
double largest_tilt(const std::vector<cv::Mat>& rotations) {
  std::vector<cv::Mat> normals;
  for (const cv::Mat& rotation : rotations) {
    cv::Mat matrix;
    cv::Rodrigues(rotation, matrix);
    normals.push_back(matrix.col(2).clone());
  }
  double smallest_cosine = 1;
  for (const cv::Mat& one : normals) {
    for (const cv::Mat& other : normals) smallest_cosine = std::min(smallest_cosine, one.dot(other));
  }
  return std::acos(std::clamp(smallest_cosine, -1.0, 1.0));
}

std::string percent(double part) { return fmt::format("{:.0f} %", part * 100); }

}  // namespace

Calibration calibrate(const BoardPictures& pictures, const Board& board) {
  if (pictures.views.size() < kViewsForAFit) {
    throw Error({.what = "a camera cannot be calibrated from so few pictures",
                 .expected = fmt::format("at least {} in which the whole board is seen", kViewsForAFit),
                 .found = fmt::format("{}", pictures.views.size())});
  }
  const std::vector<std::vector<cv::Point3f>> objects(pictures.views.size(), corners_of(board));
  std::vector<std::vector<cv::Point2f>> images;
  for (const BoardView& view : pictures.views) images.push_back(view.corners);
  cv::Mat matrix, distortion, sigmas, view_residuals;
  std::vector<cv::Mat> rotations, translations;
  Calibration result;
  try {
    result.residual_px = cv::calibrateCamera(objects, images, pictures.size, matrix, distortion, rotations,
                                             translations, sigmas, cv::noArray(), view_residuals);
  } catch (const cv::Exception& error) {
    throw Error({.what = "the fit of the camera failed", .found = error.err, .fix = "take other pictures"});
  }
  CameraModel& camera = result.camera;
  camera.width = pictures.size.width;
  camera.height = pictures.size.height;
  camera.fx = matrix.at<double>(0, 0);
  camera.fy = matrix.at<double>(1, 1);
  camera.cx = matrix.at<double>(0, 2);
  camera.cy = matrix.at<double>(1, 2);
  for (int i = 0; i < 5; ++i) camera.distortion[static_cast<std::size_t>(i)] = distortion.at<double>(i);
  result.focal_sigma = std::max(sigmas.at<double>(0) / camera.fx, sigmas.at<double>(1) / camera.fy);
  result.tilt_rad = largest_tilt(rotations);
  for (int i = 0; i < view_residuals.rows; ++i) result.view_residual_px.push_back(view_residuals.at<double>(i));
  const auto worst = std::ranges::max_element(result.view_residual_px);
  result.worst_view_px = *worst;
  result.worst_view = pictures.views[static_cast<std::size_t>(worst - result.view_residual_px.begin())].picture;
  std::tie(result.coverage_across, result.coverage_down) = coverage(pictures);
  return result;
}

Findings check_views(const BoardPictures& pictures, const CalibrationLimits& limits) {
  Findings findings;
  for (const SetAside& one : pictures.set_aside) {
    findings.add({.code = "provision.picture",
                  .severity = Severity::warning,
                  .where = one.picture,
                  .expected = "a sharp picture with the whole board in it",
                  .found = one.reason});
  }
  if (std::cmp_less(pictures.views.size(), limits.min_views)) {
    findings.add(
        {.code = "provision.few_pictures",
         .expected = fmt::format("at least {} pictures in which the board is found", limits.min_views),
         .found = fmt::format("{} of {}", pictures.views.size(), pictures.views.size() + pictures.set_aside.size()),
         .fix = "take more, sharp and with the whole board, and check --board: it counts inner corners"});
  }
  const auto [across, down] = coverage(pictures);
  if (!pictures.views.empty() && !(std::min(across, down) >= limits.min_coverage)) {
    findings.add({.code = "provision.coverage",
                  .expected = fmt::format("boards over at least {} of the picture's width and height",
                                          percent(limits.min_coverage)),
                  .found = fmt::format("{} and {}", percent(across), percent(down)),
                  .fix = "take pictures with the board near every edge: the lens bends most there"});
  }
  return findings;
}

Findings check_calibration(const Calibration& calibration, const CalibrationLimits& limits) {
  Findings findings;
  if (!(calibration.residual_px <= limits.max_residual_px)) {
    findings.add(
        {.code = "provision.residual",
         .where = calibration.worst_view,
         .expected = fmt::format("corners within {} px of where the camera would show them", limits.max_residual_px),
         .found = fmt::format("{:.2f} px, and {:.2f} px in the worst picture", calibration.residual_px,
                              calibration.worst_view_px),
         .fix = "take that picture away; make sure that the board is flat, and the lens' focus and zoom fixed"});
  }
  if (!(calibration.tilt_rad >= limits.min_tilt_rad)) {
    findings.add({.code = "provision.tilt",
                  .expected = fmt::format("boards tilted against each other by {:.0f} degrees or more",
                                          degrees(limits.min_tilt_rad)),
                  .found = fmt::format("{:.0f} degrees", degrees(calibration.tilt_rad)),
                  .fix = "add pictures with the board tilted by 20 to 45 degrees, each way"});
  }
  if (!(calibration.focal_sigma <= limits.max_focal_sigma)) {
    findings.add({.code = "provision.focal_length",
                  .expected = fmt::format("focal lengths known to {:.2f} %", limits.max_focal_sigma * 100),
                  .found = fmt::format("{:.2f} %", calibration.focal_sigma * 100),
                  .fix = "add sharp pictures with the board large and tilted"});
  }
  try {
    read_camera(YamlNode::parse(camera_yaml(calibration.camera), "camera.yaml"));
  } catch (const UsageError& error) {
    findings.add({.code = "provision.lens",
                  .expected = "a lens whose distortion can be undone over the whole picture",
                  .found = error.text().what,
                  .fix = "take pictures with the board in the corners; very wide lenses are not supported"});
  }
  return findings;
}

std::string camera_yaml(const CameraModel& camera) {
  const auto& d = camera.distortion;
  return fmt::format(
      "model: pinhole\nwidth: {}\nheight: {}\nfx: {:.4f}\nfy: {:.4f}\ncx: {:.4f}\ncy: {:.4f}\n"
      "distortion: [{:.8f}, {:.8f}, {:.8f}, {:.8f}, {:.8f}]   # k1 k2 p1 p2 k3\n",
      camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, d[0], d[1], d[2], d[3], d[4]);
}

}  // namespace nadir
