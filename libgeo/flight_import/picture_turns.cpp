#include "flight_import/picture_turns.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"
#include "geodesy/hypotenuse.hpp"
#include "imagery/frame_image.hpp"
#include "vision/feature_matching.hpp"
#include "vision/sift_features.hpp"

namespace nadir {
namespace {

constexpr int kTurnPicture_px = 640;       // longer side at which pictures are compared
constexpr double kMaxPairInterval_s = 30;  // further apart they do not overlap
constexpr std::size_t kMaxPairs = 400;
constexpr int kMinTurnInliers = 20;
constexpr double kMaxScaleChange = 1.4;

SiftFeatures turn_features(const cv::Mat& grey) {
  return sift_features(grey, {.max_features = 800, .octave_layers = 3, .min_contrast = 0.04});
}

std::optional<double> turn_from(const SiftFeatures& before, const SiftFeatures& now) {
  constexpr double kRatio = 0.8, kReprojection_px = 3;
  std::vector<cv::Point2f> from, to;
  for (const FeatureMatch& match : unambiguous_matches(before.descriptors, now.descriptors, kRatio)) {
    from.push_back(before.points[match.first]);
    to.push_back(now.points[match.second]);
  }
  if (from.size() < kMinTurnInliers) return std::nullopt;
  cv::Mat inliers;
  const cv::Mat similarity = cv::estimateAffinePartial2D(from, to, inliers, cv::RANSAC, kReprojection_px);
  if (similarity.empty() || cv::countNonZero(inliers) < kMinTurnInliers) return std::nullopt;
  const double cosine = similarity.at<double>(0, 0), sine = similarity.at<double>(1, 0);
  const double scale = hypotenuse(cosine, sine);
  if (!(scale > 1 / kMaxScaleChange && scale < kMaxScaleChange)) return std::nullopt;
  // The ground turns against the aircraft; y is down, so that a positive angle is clockwise.
  return -std::atan2(sine, cosine);
}

SiftFeatures features_of_file(const std::filesystem::path& file) {
  try {
    cv::Mat grey = read_frame_file(file, Colour::grey, 4);
    const double factor = static_cast<double>(kTurnPicture_px) / std::max(grey.cols, grey.rows);
    if (factor < 1) cv::resize(grey, grey, {}, factor, factor, cv::INTER_AREA);
    return turn_features(grey);
  } catch (const Error&) {
    return {};
  }
}

}  // namespace

std::optional<double> turn_between(const cv::Mat& before, const cv::Mat& now) {
  return turn_from(turn_features(before), turn_features(now));
}

std::vector<SeenTurn> seen_turns(const std::vector<TimedPicture>& pictures, Progress& progress) {
  std::vector<std::size_t> pairs;  // by their first picture
  for (std::size_t i = 0; i + 1 < pictures.size(); ++i) {
    const double interval_s = pictures[i + 1].time_s - pictures[i].time_s;
    if (interval_s > 0 && interval_s <= kMaxPairInterval_s) pairs.push_back(i);
  }
  if (pairs.size() > kMaxPairs) {
    std::vector<std::size_t> chosen;
    for (std::size_t i = 0; i < kMaxPairs; ++i) chosen.push_back(pairs[i * pairs.size() / kMaxPairs]);
    pairs = std::move(chosen);
  }
  std::vector<SeenTurn> turns;
  std::optional<std::size_t> last;  // the picture whose features are kept
  SiftFeatures kept;
  progress.begin("comparing pictures", pairs.size(), "pairs");
  for (const std::size_t i : pairs) {
    if (last != i) kept = features_of_file(pictures[i].file);
    SiftFeatures now = features_of_file(pictures[i + 1].file);
    if (const auto turn_rad = turn_from(kept, now)) {
      turns.push_back({pictures[i].time_s, pictures[i + 1].time_s, *turn_rad});
    }
    kept = std::move(now);
    last = i + 1;
    progress.advance();
  }
  progress.end();
  return turns;
}

}  // namespace nadir
