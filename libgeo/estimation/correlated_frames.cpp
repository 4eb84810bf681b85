#include "estimation/correlated_frames.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <optional>

#include "vision/map_search.hpp"
#include "vision/matching_plan.hpp"
#include "vision/patch_matching.hpp"

namespace nadir {

namespace tuned = parameters::correlated_frames;

namespace {

// Brightness that varies slowly over the picture, as a polynomial of degree 4 in both directions: a lens darkens
// towards its corners by about cos^4, the sky's light fades over haze. It moves along with the camera.
class SlowBrightness {
 public:
  explicit SlowBrightness(const cv::Mat& grey) {
    Eigen::Matrix<double, kTerms, kTerms> normal = Eigen::Matrix<double, kTerms, kTerms>::Zero();
    Terms right = Terms::Zero();
    for (int row = 0; row < tuned::kBrightnessCells; ++row) {
      for (int column = 0; column < tuned::kBrightnessCells; ++column) {
        const cv::Range rows = part(row, grey.rows), columns = part(column, grey.cols);
        if (rows.empty() || columns.empty()) continue;
        const double level = cv::mean(grey(rows, columns))[0];
        const Terms terms = terms_at(centred((rows.start + rows.end) / 2.0, grey.rows),
                                     centred((columns.start + columns.end) / 2.0, grey.cols));
        normal += terms * terms.transpose();
        right += level * terms;
      }
    }
    coefficients_ = normal.ldlt().solve(right);
  }

  // Of the whole picture's rows and columns, -1 to 1.
  double at(double down, double across) const { return coefficients_.dot(terms_at(down, across)); }

  static double centred(double at, int length) { return 2 * at / length - 1; }

 private:
  static constexpr int kDegree = 4, kTerms = (kDegree + 1) * (kDegree + 2) / 2;
  using Terms = Eigen::Matrix<double, kTerms, 1>;

  static cv::Range part(int number, int length) {
    return {number * length / tuned::kBrightnessCells, (number + 1) * length / tuned::kBrightnessCells};
  }

  static Terms terms_at(double down, double across) {
    Terms terms;
    int next = 0;
    double power_down = 1;
    for (int i = 0; i <= kDegree; ++i, power_down *= down) {
      double both = power_down;
      for (int k = 0; k <= kDegree - i; ++k, both *= across) terms[next++] = both;
    }
    return terms;
  }

  Terms coefficients_ = Terms::Zero();
};

// Without the slow brightness, which is not the ground's. A dark picture has few grey levels: they are spread before
// pixels are averaged, so that rounding takes nothing away.
cv::Mat with_contrast(const cv::Mat& grey) {
  const SlowBrightness slow(grey);
  cv::Mat ground(grey.size(), CV_32FC1), result(grey.size(), CV_8UC1);
  double squares = 0;
  for (int row = 0; row < grey.rows; ++row) {
    const auto* from = grey.ptr<std::uint8_t>(row);
    auto* to = ground.ptr<float>(row);
    const double down = SlowBrightness::centred(row + 0.5, grey.rows);
    for (int column = 0; column < grey.cols; ++column) {
      to[column] = static_cast<float>(from[column] - slow.at(down, SlowBrightness::centred(column + 0.5, grey.cols)));
      squares += static_cast<double>(to[column]) * static_cast<double>(to[column]);
    }
  }
  // By hand: OpenCV's conversion fuses products on some processors and not on others.
  const double deviation = std::sqrt(squares / static_cast<double>(grey.total()));
  const double gain = std::max(1.0, tuned::kContrast / std::max(1.0, deviation));
  for (int row = 0; row < grey.rows; ++row) {
    const auto* from = ground.ptr<float>(row);
    auto* to = result.ptr<std::uint8_t>(row);
    for (int column = 0; column < grey.cols; ++column) {
      to[column] = cv::saturate_cast<std::uint8_t>(tuned::kMiddleGrey + gain * static_cast<double>(from[column]));
    }
  }
  return result;
}

PlaneBox around_both(const PlaneBox& one, const PlaneBox& other, double margin_m) {
  PlaneBox all = one;
  all.west_m = std::min(one.west_m, other.west_m - margin_m);
  all.south_m = std::min(one.south_m, other.south_m - margin_m);
  all.east_m = std::max(one.east_m, other.east_m + margin_m);
  all.north_m = std::max(one.north_m, other.north_m + margin_m);
  return all;
}

CameraPose pose_of(const OdometryFrame& frame) { return {{}, frame.agl_m, frame.attitude}; }

cv::Point2f pixel_of(const OdometryFrame& frame, const CameraPose& pose, PlanePoint ground) {
  const Eigen::Vector2d pixel = frame.camera.pixel_from_point(camera_from_ground(pose, ground));
  return {static_cast<float>(pixel.x()), static_cast<float>(pixel.y())};
}

// The frame before as the map of what the frame now may show; nothing where that is more than a level flight sees.
std::optional<MapWindow> map_of(const OdometryFrame& before, const OdometryFrame& now, double gsd_m, double reach_m) {
  const CameraPose pose = pose_of(before);
  const auto seen_before = footprint_of(before.camera, pose), seen_now = footprint_of(now.camera, pose_of(now));
  if (!seen_before || !seen_now) return std::nullopt;
  const PlaneBox searched = around_both(*seen_before, *seen_now, reach_m + tuned::kMargin_px * gsd_m);
  const double most_m = tuned::kMostSide_px * gsd_m;
  if (searched.east_m - searched.west_m > most_m || searched.north_m - searched.south_m > most_m) return std::nullopt;
  MapWindow map;
  map.west_m = searched.west_m;
  map.north_m = searched.north_m;
  map.gsd_m = gsd_m;
  const ReducedFrame frame = reduce_frame(with_contrast(before.grey), before.camera, before.agl_m, gsd_m);
  const RectifiedFrame ground = rectify(frame, pose, grid_over(searched, map));
  map.image = ground.image;
  map.mask = ground.mask;
  return map;
}

// Where the frame now was taken, if one place of the map stands out.
std::optional<CameraPose> place_on(const MapWindow& map, const OdometryFrame& now, const cv::Mat& grey,
                                   double reach_m) {
  SearchPrior prior;
  prior.pose = pose_of(now);
  prior.radius_m = reach_m;
  SearchOptions options;
  options.gsd_m = map.gsd_m;
  options.distinct_m = tuned::kDistinct_px * map.gsd_m;
  const SearchResult found = search_window(grey, now.camera, map, prior, options);
  const bool several = found.places.size() > 1;
  if (found.places.empty() || (several && found.ratio > tuned::kMaxRatio)) return std::nullopt;
  return found.places.front().pose;
}

PatchMatches patches_on(const MapWindow& map, const OdometryFrame& now, const cv::Mat& grey, const CameraPose& pose) {
  const auto footprint = footprint_of(now.camera, pose);
  if (!footprint) return {};
  PatchOptions options;
  options.patch_px = tuned::kPatch_px;
  options.columns = tuned::kPatchColumns;
  options.rows = tuned::kPatchRows;
  options.search_px = tuned::kPatchSearch_px;
  const ReducedFrame frame = reduce_frame(grey, now.camera, now.agl_m, map.gsd_m);
  return match_patches(rectify(frame, pose, grid_over(*footprint, map)), frame.camera, pose, map, options);
}

}  // namespace

PixelPairs correlated_pixels(const OdometryFrame& before, const OdometryFrame& now) {
  const double side_m = footprint_side_m(before.camera, before.agl_m);
  const double gsd_m = side_m / tuned::kWidth_px, reach_m = tuned::kReachShare * side_m;
  const auto map = map_of(before, now, gsd_m, reach_m);
  if (!map) return {};
  const cv::Mat grey = with_contrast(now.grey);
  const auto pose = place_on(*map, now, grey, reach_m);
  if (!pose) return {};
  PixelPairs pairs;
  pairs.redundancy = tuned::kRedundancy;
  pairs.still_px = tuned::kStill_px * gsd_m * before.camera.fx / before.agl_m;
  for (const PatchMatch& match : patches_on(*map, now, grey, *pose).found) {
    pairs.before.push_back(pixel_of(before, pose_of(before), match.on_map));
    pairs.now.push_back(pixel_of(now, *pose, match.in_frame));
  }
  return pairs;
}

}  // namespace nadir
