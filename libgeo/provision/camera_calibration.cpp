#include "provision/camera_calibration.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <tuple>
#include <utility>

#include "base/error.hpp"
#include "base/number_text.hpp"
#include "base/yaml.hpp"
#include "geodesy/angles.hpp"
#include "imagery/frame_image.hpp"
#include "replay/flight_folder.hpp"
#include "vision/camera.hpp"

namespace nadir {
namespace {

constexpr int kMinCorners = 3;
constexpr int kMaxCorners = 50;

bool read_count(std::string_view text, int& count) {
  count = whole_number<int>(text).value_or(0);
  return count >= kMinCorners && count <= kMaxCorners;
}

std::vector<std::filesystem::path> images_of(const std::filesystem::path& folder) {
  if (!std::filesystem::is_directory(folder)) {
    throw UsageError({.what = "cannot read the images",
                      .where = folder,
                      .expected = "a folder with images of a checkerboard",
                      .found = std::filesystem::exists(folder) ? "a file" : "nothing"});
  }
  std::vector<std::filesystem::path> images;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.is_regular_file() && has_frame_extension(entry.path())) images.push_back(entry.path());
  }
  if (images.empty()) {
    throw UsageError({.what = "the folder has no images",
                      .where = folder,
                      .expected = "JPEG, PNG or TIFF files of a checkerboard",
                      .found = "none"});
  }
  std::ranges::sort(images);
  return images;
}

void find_in(const std::filesystem::path& path, const Board& board, BoardImages& result) {
  cv::Mat grey;
  try {
    grey = read_frame_file(path, Colour::grey);
  } catch (const Error& error) {
    result.rejected.push_back({path.filename(), "damaged: " + error.text().what});
    return;
  }
  if (result.size.empty()) result.size = grey.size();
  if (grey.size() != result.size) {
    throw UsageError({.what = "the images are not all of one size",
                      .where = path,
                      .expected = fmt::format("{} x {} pixels, as the first", result.size.width, result.size.height),
                      .found = fmt::format("{} x {}", grey.cols, grey.rows),
                      .fix = "give images of one camera in one mode, the one that it flies with"});
  }
  auto view = find_board(grey, board, path.filename());
  if (!view) {
    result.rejected.push_back(
        {path.filename(), fmt::format("no whole board of {} x {} inner corners", board.columns, board.rows)});
  } else if (!(view->edge_width_px <= kMaxEdgeWidth_px)) {
    result.rejected.push_back(
        {path.filename(), fmt::format("blurred: edges are {:.1f} pixels wide, at most {:.0f} allowed",
                                      view->edge_width_px, kMaxEdgeWidth_px)});
  } else {
    result.views.push_back(std::move(*view));
  }
}

// The finder places corners by a model of a flat, undistorted neighbourhood, which is off by 0.1 px where the board is
// tilted or the lens bends it: enough to make a focal length wrong by 0.8 %. Gradients around each corner are not.
void refine(const cv::Mat& grey, std::vector<cv::Point2f>& corners) {
  double spacing_px = cv::norm(corners[1] - corners[0]);
  for (std::size_t i = 1; i < corners.size(); ++i) {
    spacing_px = std::min(spacing_px, cv::norm(corners[i] - corners[i - 1]));
  }
  const int reach = std::clamp(static_cast<int>(spacing_px / 4), 2, 5);  // stays away from the neighbours
  cv::cornerSubPix(grey, corners, {reach, reach}, {-1, -1},
                   {cv::TermCriteria::EPS + cv::TermCriteria::COUNT, 50, 1e-4});
}

}  // namespace

Board parse_board(std::string_view text, double square_m) {
  Board board{.square_m = square_m};
  const std::size_t cross = text.find('x');
  const bool reads = cross != std::string_view::npos && read_count(text.substr(0, cross), board.columns) &&
                     read_count(text.substr(cross + 1), board.rows);
  if (!reads) {
    throw UsageError({.what = "cannot parse the board",
                      .where = "--board",
                      .expected = fmt::format("inner corners across and down, each from {} to {}, such as 9x6",
                                              kMinCorners, kMaxCorners),
                      .found = std::string(text)});
  }
  if (board.columns % 2 == board.rows % 2) {
    throw UsageError({.what = "the board looks the same when it is turned by 180 degrees",
                      .where = "--board",
                      .expected = "an odd number of inner corners one way and an even one the other, such as 9x6",
                      .found = std::string(text)});
  }
  return board;
}

std::optional<BoardView> find_board(const cv::Mat& grey, const Board& board, std::string image) {
  const cv::Size pattern(board.columns, board.rows);
  BoardView view{.image = std::move(image)};
  if (!cv::findChessboardCornersSB(grey, pattern, view.corners, cv::CALIB_CB_ACCURACY | cv::CALIB_CB_NORMALIZE_IMAGE)) {
    return std::nullopt;
  }
  refine(grey, view.corners);
  view.edge_width_px = cv::estimateChessboardSharpness(grey, pattern, view.corners)[0];
  return view;
}

BoardImages find_boards(const std::filesystem::path& folder, const Board& board, Progress& progress) {
  const auto images = images_of(folder);
  BoardImages result;
  progress.begin("finding the board", images.size(), "images");
  for (const auto& image : images) {
    find_in(image, board, result);
    progress.advance();
  }
  progress.end();
  return result;
}

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

// Of the image's width and height, what lies between the outermost corners of all views.
std::pair<double, double> coverage(const BoardImages& images) {
  std::vector<cv::Point2f> all;
  for (const BoardView& view : images.views) all.insert(all.end(), view.corners.begin(), view.corners.end());
  if (all.empty()) return {0, 0};
  const auto [left, right] = std::ranges::minmax(all, {}, &cv::Point2f::x);
  const auto [top, bottom] = std::ranges::minmax(all, {}, &cv::Point2f::y);
  return {static_cast<double>(right.x - left.x) / images.size.width,
          static_cast<double>(bottom.y - top.y) / images.size.height};
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

Calibration calibrate(const BoardImages& images, const Board& board) {
  if (images.views.size() < kViewsForAFit) {
    throw Error({.what = "too few images to calibrate a camera",
                 .expected = fmt::format("at least {} with the whole board", kViewsForAFit),
                 .found = fmt::format("{}", images.views.size())});
  }
  const std::vector<std::vector<cv::Point3f>> objects(images.views.size(), corners_of(board));
  std::vector<std::vector<cv::Point2f>> corners;
  for (const BoardView& view : images.views) corners.push_back(view.corners);
  cv::Mat matrix, distortion, sigmas, view_residuals;
  std::vector<cv::Mat> rotations, translations;
  Calibration result;
  try {
    result.residual_px = cv::calibrateCamera(objects, corners, images.size, matrix, distortion, rotations, translations,
                                             sigmas, cv::noArray(), view_residuals);
  } catch (const cv::Exception& error) {
    throw Error({.what = "the fit of the camera failed", .found = error.err, .fix = "take other images"});
  }
  CameraModel& camera = result.camera;
  camera.width = images.size.width;
  camera.height = images.size.height;
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
  result.worst_view = images.views[static_cast<std::size_t>(worst - result.view_residual_px.begin())].image;
  std::tie(result.coverage_across, result.coverage_down) = coverage(images);
  return result;
}

Findings check_views(const BoardImages& images, const CalibrationLimits& limits) {
  Findings findings;
  for (const RejectedImage& one : images.rejected) {
    findings.add({.code = "provision.picture",
                  .severity = Severity::warning,
                  .where = one.image,
                  .expected = "a sharp image with the whole board in it",
                  .found = one.reason});
  }
  if (std::cmp_less(images.views.size(), limits.min_views)) {
    findings.add({.code = "provision.few_pictures",
                  .expected = fmt::format("at least {} images in which the board is found", limits.min_views),
                  .found = fmt::format("{} of {}", images.views.size(), images.views.size() + images.rejected.size()),
                  .fix = "take more, sharp and with the whole board, and check --board: it counts inner corners"});
  }
  const auto [across, down] = coverage(images);
  if (!images.views.empty() && !(std::min(across, down) >= limits.min_coverage)) {
    findings.add({.code = "provision.coverage",
                  .expected = fmt::format("boards over at least {} of the image's width and height",
                                          percent(limits.min_coverage)),
                  .found = fmt::format("{} and {}", percent(across), percent(down)),
                  .fix = "take images with the board near every edge: the lens bends most there"});
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
         .found = fmt::format("{:.2f} px, and {:.2f} px in the worst image", calibration.residual_px,
                              calibration.worst_view_px),
         .fix = "remove that image; make sure that the board is flat, and the lens' focus and zoom fixed"});
  }
  if (!(calibration.tilt_rad >= limits.min_tilt_rad)) {
    findings.add({.code = "provision.tilt",
                  .expected = fmt::format("boards tilted relative to each other by {:.0f} degrees or more",
                                          degrees(limits.min_tilt_rad)),
                  .found = fmt::format("{:.0f} degrees", degrees(calibration.tilt_rad)),
                  .fix = "add images with the board tilted by 20 to 45 degrees, each way"});
  }
  if (!(calibration.focal_sigma <= limits.max_focal_sigma)) {
    findings.add({.code = "provision.focal_length",
                  .expected = fmt::format("focal lengths known to {:.2f} %", limits.max_focal_sigma * 100),
                  .found = fmt::format("{:.2f} %", calibration.focal_sigma * 100),
                  .fix = "add sharp images with the board large and tilted"});
  }
  try {
    read_camera(YamlNode::parse(camera_yaml(calibration.camera), "camera.yaml"));
  } catch (const UsageError& error) {
    findings.add({.code = "provision.lens",
                  .expected = "a lens whose distortion can be inverted over the whole image",
                  .found = error.text().what,
                  .fix = "take images with the board in the corners; very wide lenses are not supported"});
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
