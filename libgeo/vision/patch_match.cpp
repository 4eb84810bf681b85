#include "vision/patch_match.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "vision/correlation.hpp"
#include "vision/near_correlation.hpp"

namespace nadir {
namespace {

// A correlation of 1 whose peak falls by `curvature` over a pixel is located to about sqrt(noise / curvature); the
// noise of the score is what the best wrong placements reach. Floor: no patch is better than a fifth of a pixel.
constexpr double kScoreNoise = 0.04;
constexpr double kFloor_px = 0.3;
constexpr double kMinValid = 0.8;  // share of a patch that must lie on valid map

// Corners of the patches in the rectified picture that the frame really covers.
std::vector<cv::Rect> patch_places(const RectifiedFrame& frame, const CameraModel& camera, const CameraPose& pose,
                                   const PatchOptions& options, const GroundSurface& surface) {
  constexpr double kMargin = 0.04;  // of the picture: patches at the very rim stick out
  std::vector<cv::Rect> places;
  cv::Mat sums;
  cv::integral(frame.mask, sums, CV_64F);
  const auto covered = [&](const cv::Rect& r) {
    return sums.at<double>(r.br()) - sums.at<double>(r.y, r.x + r.width) - sums.at<double>(r.y + r.height, r.x) +
           sums.at<double>(r.tl());
  };
  const cv::Rect whole(0, 0, frame.mask.cols, frame.mask.rows);
  for (int j = 0; j < options.rows; ++j) {
    for (int i = 0; i < options.columns; ++i) {
      const double u = kMargin + (1 - 2 * kMargin) * (i + 0.5) / options.columns;
      const double v = kMargin + (1 - 2 * kMargin) * (j + 0.5) / options.rows;
      const auto ground = ground_from_ray(pose, camera.ray_from_pixel({u * camera.width, v * camera.height}), surface);
      if (!ground) continue;
      const cv::Rect place(
          static_cast<int>(std::lround((ground->east_m - frame.grid.west_m) / frame.grid.gsd_m)) - options.patch_px / 2,
          static_cast<int>(std::lround((frame.grid.north_m - ground->north_m) / frame.grid.gsd_m)) -
              options.patch_px / 2,
          options.patch_px, options.patch_px);
      if ((place & whole) == place && covered(place) >= 0.8 * 255.0 * place.area()) places.push_back(place);
    }
  }
  return places;
}

Eigen::Matrix2d information_of(const cv::Mat& scores, const Peak& peak, double gsd_m) {
  const int x = static_cast<int>(std::lround(peak.x)), y = static_cast<int>(std::lround(peak.y));
  double cross = 0;
  if (x > 0 && y > 0 && x + 1 < scores.cols && y + 1 < scores.rows) {
    cross = -0.25 * static_cast<double>(scores.at<float>(y + 1, x + 1) - scores.at<float>(y + 1, x - 1) -
                                        scores.at<float>(y - 1, x + 1) + scores.at<float>(y - 1, x - 1));
  }
  // Rows grow south, north grows up: the mixed term changes its sign.
  Eigen::Matrix2d hessian;
  hessian << peak.curvature_x, -cross, -cross, peak.curvature_y;
  const Eigen::Matrix2d information_px = hessian / kScoreNoise;
  const Eigen::Matrix2d covariance_px = (information_px + 0.01 * Eigen::Matrix2d::Identity()).inverse() +
                                        kFloor_px * kFloor_px * Eigen::Matrix2d::Identity();
  return covariance_px.inverse() / (gsd_m * gsd_m);
}

// Scores of placements next to one another, of which the first has the pattern's corner at `first` of the map.
struct Scored {
  cv::Mat scores;
  cv::Point first;
};

// Every other placement, then all around the best of those: the channels are smooth enough not to hide a peak between.
Scored near_scores(const LocalTemplate& pattern, const QuantizedChannels& map, cv::Point first, int side) {
  constexpr int kStep = 2, kAround = 2;
  const int coarse_side = (side + kStep - 1) / kStep;
  cv::Point best;
  cv::minMaxLoc(pattern.scores(map, first, {coarse_side, coarse_side}, kMinValid, kStep), nullptr, nullptr, nullptr,
                &best);
  const cv::Rect fine = cv::Rect(kStep * best.x - kAround, kStep * best.y - kAround, 2 * kAround + 1, 2 * kAround + 1) &
                        cv::Rect(0, 0, side, side);
  return {pattern.scores(map, first + fine.tl(), fine.size(), kMinValid), first + fine.tl()};
}

std::optional<PatchMatch> match_one(const QuantizedChannels& frame, const QuantizedChannels& map, const cv::Rect& place,
                                    cv::Point map_offset, const GroundGrid& grid, const PatchOptions& options) {
  const int search = static_cast<int>(std::ceil(options.search_px));
  const cv::Rect wide(place.x + map_offset.x - search, place.y + map_offset.y - search, place.width + 2 * search,
                      place.height + 2 * search);
  if ((wide & cv::Rect(cv::Point(), map.size())) != wide) return std::nullopt;
  const Scored found = near_scores(LocalTemplate(frame, place), map, wide.tl(), 2 * search + 1);
  Peak peak = best_peak(found.scores);
  const Eigen::Matrix2d information_m2 = information_of(found.scores, peak, grid.gsd_m);
  peak.x += found.first.x - wide.x;
  peak.y += found.first.y - wide.y;
  const bool at_rim = peak.x < 0.5 || peak.y < 0.5 || peak.x > 2 * search - 0.5 || peak.y > 2 * search - 0.5;
  if (peak.score < options.min_score || at_rim) return std::nullopt;
  PatchMatch match;
  match.score = peak.score;
  match.in_frame = grid.plane_from_pixel(place.x + place.width / 2.0, place.y + place.height / 2.0);
  match.on_map = {match.in_frame.east_m + (peak.x - search) * grid.gsd_m,
                  match.in_frame.north_m - (peak.y - search) * grid.gsd_m};
  match.information_m2 = information_m2;
  if (!match.information_m2.allFinite()) return std::nullopt;
  return match;
}

}  // namespace

PatchMatches match_patches(const RectifiedFrame& frame, const CameraModel& camera, const CameraPose& pose,
                           const MapWindow& map, MapChannels& map_channels, const PatchOptions& options,
                           const GroundSurface& surface) {
  const cv::Point map_offset(static_cast<int>(std::lround((frame.grid.west_m - map.west_m) / map.gsd_m)),
                             static_cast<int>(std::lround((map.north_m - frame.grid.north_m) / map.gsd_m)));
  const int margin = static_cast<int>(std::ceil(options.search_px)) + 8;  // 8: reach of the channels' smoothing
  const cv::Rect used(map_offset.x - margin, map_offset.y - margin, frame.grid.columns + 2 * margin,
                      frame.grid.rows + 2 * margin);
  PatchMatches matches;
  if ((used & cv::Rect(cv::Point(), map_channels.map_size())).empty()) return matches;
  const Likeness& like = options.likeness;
  const QuantizedChannels on_frame(oriented_channels(frame.image, frame.mask, like.fine, like.channels));
  map_channels.cover(used);
  const cv::Point offset = map_channels.inside(map_offset);
  const auto places = patch_places(frame, camera, pose, options, surface);
  matches.tried = static_cast<int>(places.size());
  for (const cv::Rect& place : places) {
    if (const auto match = match_one(on_frame, map_channels.channels(), place, offset, frame.grid, options)) {
      matches.found.push_back(*match);
    }
  }
  return matches;
}

PatchMatches match_patches(const RectifiedFrame& frame, const CameraModel& camera, const CameraPose& pose,
                           const MapWindow& map, const PatchOptions& options, const GroundSurface& surface) {
  MapChannels channels(map.image, map.mask, options.likeness.fine, options.likeness.channels);
  return match_patches(frame, camera, pose, map, channels, options, surface);
}

}  // namespace nadir
