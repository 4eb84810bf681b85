#include "flight_adjustment/tie_matching.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <opencv2/calib3d.hpp>

#include "adjustment/adjustment_parameters.hpp"
#include "base/platform.hpp"
#include "geodesy/hypotenuse.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {
namespace {

using namespace parameters::ties;

constexpr std::int32_t kNoDistance = std::numeric_limits<std::int32_t>::max();

NADIR_FOR_WIDE_REGISTERS std::int32_t squared_distance(const std::uint8_t* a, const std::uint8_t* b) {
  std::int32_t sum = 0;
  for (std::size_t k = 0; k < TieFeatures::kLength; ++k) {
    const std::int32_t difference = static_cast<std::int32_t>(a[k]) - b[k];
    sum += difference * difference;
  }
  return sum;
}

// The features of a picture by where they are.
class FeatureGrid {
 public:
  FeatureGrid(const std::vector<cv::Point2f>& points, const CameraModel& camera)
      : columns_(1 + static_cast<int>(camera.width / kCell_px)),
        rows_(1 + static_cast<int>(camera.height / kCell_px)),
        cells_(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_)) {
    for (std::size_t i = 0; i < points.size(); ++i) {
      cells_[cell(column(points[i].x), row(points[i].y))].push_back(i);
    }
  }

  template <typename Use>
  void around(const Eigen::Vector2d& at, double reach_px, Use use) const {
    for (int r = row(at.y() - reach_px); r <= row(at.y() + reach_px); ++r) {
      for (int c = column(at.x() - reach_px); c <= column(at.x() + reach_px); ++c) {
        for (const std::size_t i : cells_[cell(c, r)]) use(i);
      }
    }
  }

 private:
  static int along(double at, int cells) {
    return static_cast<int>(std::clamp(std::floor(at / kCell_px), 0.0, static_cast<double>(cells - 1)));
  }
  int column(double x) const { return along(x, columns_); }
  int row(double y) const { return along(y, rows_); }
  std::size_t cell(int c, int r) const {
    return static_cast<std::size_t>(r) * static_cast<std::size_t>(columns_) + static_cast<std::size_t>(c);
  }

  int columns_, rows_;
  std::vector<std::vector<std::size_t>> cells_;
};

struct NearestTie {
  std::int32_t best = kNoDistance, second = kNoDistance;
  std::size_t at = 0;
};

Eigen::Vector2d pixel_of(const cv::Point2f& point) { return {point.x, point.y}; }

}  // namespace

TieView tie_view(TieFeatures features, const CameraModel& camera, const CameraPose& pose, const GroundSurface& ground) {
  TieView view{std::move(features), pose, {}, {}};
  for (const cv::Point2f& point : view.features.points) {
    const Eigen::Vector3d ray = camera.ray_from_pixel(pixel_of(point));
    view.straight.emplace_back(static_cast<float>(camera.fx * ray.x() + camera.cx),
                               static_cast<float>(camera.fy * ray.y() + camera.cy));
    view.ground.push_back(ground_from_ray(pose, ray, ground));
  }
  return view;
}

std::vector<FeatureMatch> match_ties(const TieView& first, const TieView& second, const CameraModel& camera,
                                     const GroundSurface& ground, double reach_px) {
  const FeatureGrid grid(second.features.points, camera);
  const double rivals_px = std::max(reach_px, kRivalReach * camera.width);
  // Of each feature of the second picture, the one that fits it best.
  std::vector<std::pair<std::int32_t, std::size_t>> taken(second.features.size(), {kNoDistance, 0});
  for (std::size_t i = 0; i < first.features.size(); ++i) {
    if (!first.ground[i]) continue;
    const Eigen::Vector3d point = camera_from_ground(second.pose, *first.ground[i], ground);
    if (!(point.z() > parameters::adjustment::kMinDepth_m)) continue;
    const Eigen::Vector2d expected = camera.pixel_from_point(point);
    if (!(expected.x() > -reach_px && expected.x() < camera.width + reach_px && expected.y() > -reach_px &&
          expected.y() < camera.height + reach_px)) {
      continue;
    }
    NearestTie within, beyond;  // reach
    grid.around(expected, rivals_px, [&](std::size_t j) {
      const double off_px = (pixel_of(second.features.points[j]) - expected).norm();
      if (off_px > rivals_px) return;
      const std::int32_t distance = squared_distance(first.features.descriptor(i), second.features.descriptor(j));
      NearestTie& nearest = off_px <= reach_px ? within : beyond;
      if (distance < nearest.best) {
        nearest = {distance, nearest.best, j};
      } else if (distance < nearest.second) {
        nearest.second = distance;
      }
    });
    if (within.best == kNoDistance || within.best > kMostDistance2) continue;
    const std::int32_t rival = std::min(within.second, beyond.best);
    if (rival != kNoDistance && within.best >= kTieRatio * kTieRatio * rival) continue;
    auto& best = taken[within.at];
    if (within.best < best.first) best = {within.best, i};
  }
  std::vector<FeatureMatch> matches;
  for (std::size_t j = 0; j < taken.size(); ++j) {
    if (taken[j].first != kNoDistance) matches.push_back({taken[j].second, j});
  }
  return matches;
}

std::vector<FeatureMatch> agreeing_ties(const TieView& first, const TieView& second, const CameraModel& camera,
                                        double relief_sigma_m, const std::vector<FeatureMatch>& matches) {
  std::vector<FeatureMatch> agreeing;
  if (matches.size() < kLeastAgreeing) return agreeing;
  std::vector<cv::Point2f> from, to;
  for (const FeatureMatch& match : matches) {
    from.push_back(first.straight[match.first]);
    to.push_back(second.straight[match.second]);
  }
  const double height_m = std::min(first.pose.agl_m, second.pose.agl_m);
  const double baseline_m = distance_m(first.pose.position, second.pose.position);
  const double parallax_px = camera.fx * std::min(baseline_m, height_m) * relief_sigma_m / (height_m * height_m);
  using namespace parameters::visual_odometry;
  const double bound_px = hypotenuse(kHomographyThreshold_px, std::min(parallax_px, kMostParallax_px));
  std::vector<std::uint8_t> inlier;
  const cv::Mat homography =
      cv::findHomography(from, to, cv::USAC_MAGSAC, bound_px, inlier, kHomographyIterations, kHomographyConfidence);
  if (homography.empty()) return agreeing;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (inlier[i] != 0) agreeing.push_back(matches[i]);
  }
  const auto least = std::max<std::size_t>(
      kLeastAgreeing, static_cast<std::size_t>(kLeastAgreeingShare * static_cast<double>(matches.size())));
  if (agreeing.size() < least) agreeing.clear();
  return agreeing;
}

}  // namespace nadir
