#include "vision/patch_matching.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>

#include "vision/correlation.hpp"

namespace nadir {
namespace {

// Patches in the rectified frame that the camera's image really covers. Their corners lie at `even` or an even number
// of pixels beside.
std::vector<cv::Rect> patch_rectangles(const RectifiedFrame& frame, const CameraModel& camera, const CameraPose& pose,
                                       const PatchOptions& options, const GroundSurface& surface, cv::Point even) {
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
      const double u = kPatchFrameMargin + (1 - 2 * kPatchFrameMargin) * (i + 0.5) / options.columns;
      const double v = kPatchFrameMargin + (1 - 2 * kPatchFrameMargin) * (j + 0.5) / options.rows;
      const auto ground = ground_from_ray(pose, camera.ray_from_pixel({u * camera.width, v * camera.height}), surface);
      if (!ground) continue;
      const auto corner = [&](double middle_px, int first) {
        return first + 2 * static_cast<int>(std::lround((middle_px - first - options.patch_px / 2.0) / 2));
      };
      const cv::Rect place(corner((ground->east_m - frame.grid.west_m) / frame.grid.gsd_m, even.x),
                           corner((frame.grid.north_m - ground->north_m) / frame.grid.gsd_m, even.y), options.patch_px,
                           options.patch_px);
      if ((place & whole) == place && covered(place) >= kPatchMinCovered * 255.0 * place.area())
        places.push_back(place);
    }
  }
  return places;
}

// Scores of adjacent placements, of which the first has the template's corner at `first` of the map.
struct Scored {
  cv::Mat scores;
  cv::Point first;
};

// The frame and the map at full and at half resolution.
struct BothScales {
  BothScales(QuantizedChannels on_frame, const QuantizedChannels& on_map, const QuantizedChannels& half_on_map,
             cv::Point map_offset)
      : frame(std::move(on_frame)),
        map(on_map),
        half_map(half_on_map),
        offset(map_offset),
        even(map_offset.x & 1, map_offset.y & 1),
        half_frame(frame.halved(even)) {}

  const QuantizedChannels frame;
  const QuantizedChannels &map, &half_map;
  const cv::Point offset;  // of the frame in the map
  const cv::Point even;    // the first pixel of the frame that is the first of four which the map's half joins
  const QuantizedChannels half_frame;
};

// Every other placement at half the resolution, then all around the best of those.
Scored near_scores(const BothScales& of, const cv::Rect& place, int search) {
  const int reach = search / 2;
  const cv::Rect half((place.x - of.even.x) / 2, (place.y - of.even.y) / 2, place.width / 2, place.height / 2);
  const cv::Point middle = half.tl() + (of.offset + of.even) / 2;
  cv::Point best;
  cv::minMaxLoc(
      LocalTemplate(of.half_frame, half)
          .scores(of.half_map, middle - cv::Point(reach, reach), {2 * reach + 1, 2 * reach + 1}, kPatchMinValid),
      nullptr, nullptr, nullptr, &best);
  const cv::Point expected = place.tl() + of.offset, there = expected + 2 * (best - cv::Point(reach, reach));
  const cv::Rect fine =
      cv::Rect(there.x - kPatchAround_px, there.y - kPatchAround_px, 2 * kPatchAround_px + 1, 2 * kPatchAround_px + 1) &
      cv::Rect(expected.x - search, expected.y - search, 2 * search + 1, 2 * search + 1);
  return {LocalTemplate(of.frame, place).scores(of.map, fine.tl(), fine.size(), kPatchMinValid), fine.tl()};
}

std::optional<PatchMatch> match_one(const BothScales& pictures, const cv::Rect& place, const GroundGrid& grid,
                                    const PatchOptions& options) {
  const int search = static_cast<int>(std::ceil(options.search_px));
  const cv::Rect wide(place.x + pictures.offset.x - search, place.y + pictures.offset.y - search,
                      place.width + 2 * search, place.height + 2 * search);
  if ((wide & cv::Rect(cv::Point(), pictures.map.size())) != wide) return std::nullopt;
  const Scored found = near_scores(pictures, place, search);
  Peak peak = best_peak(found.scores);
  const Eigen::Matrix2d information_m2 = peak_information_m2(found.scores, peak, grid.gsd_m);
  peak.x += found.first.x - wide.x;
  peak.y += found.first.y - wide.y;
  const bool at_border = peak.x < 0.5 || peak.y < 0.5 || peak.x > 2 * search - 0.5 || peak.y > 2 * search - 0.5;
  if (peak.score < options.min_score || at_border) return std::nullopt;
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

Eigen::Matrix2d peak_information_m2(const cv::Mat& scores, const Peak& peak, double gsd_m) {
  const int x = static_cast<int>(std::lround(peak.x)), y = static_cast<int>(std::lround(peak.y));
  double cross = 0;
  if (x > 0 && y > 0 && x + 1 < scores.cols && y + 1 < scores.rows) {
    cross = -static_cast<double>(scores.at<float>(y + 1, x + 1) - scores.at<float>(y + 1, x - 1) -
                                 scores.at<float>(y - 1, x + 1) + scores.at<float>(y - 1, x - 1)) /
            4;
  }
  // Rows grow south, north grows up: the mixed term changes its sign.
  Eigen::Matrix2d hessian;
  hessian << peak.curvature_x, -cross, -cross, peak.curvature_y;
  const Eigen::Matrix2d information_px = hessian / kPatchScoreNoise;
  const Eigen::Matrix2d covariance_px =
      (information_px + kPatchWeakInformation * Eigen::Matrix2d::Identity()).inverse() +
      kPatchSigmaFloor_px * kPatchSigmaFloor_px * Eigen::Matrix2d::Identity();
  return covariance_px.inverse() / (gsd_m * gsd_m);
}

PatchMatches match_patches(const RectifiedFrame& frame, const CameraModel& camera, const CameraPose& pose,
                           const MapWindow& map, MapChannels& map_channels, const PatchOptions& options,
                           const GroundSurface& surface) {
  const cv::Point map_offset(static_cast<int>(std::lround((frame.grid.west_m - map.west_m) / map.gsd_m)),
                             static_cast<int>(std::lround((map.north_m - frame.grid.north_m) / map.gsd_m)));
  const int margin = static_cast<int>(std::ceil(options.search_px)) + kChannelReach_px;
  const cv::Rect used(map_offset.x - margin, map_offset.y - margin, frame.grid.columns + 2 * margin,
                      frame.grid.rows + 2 * margin);
  PatchMatches matches;
  if ((used & cv::Rect(cv::Point(), map_channels.map_size())).empty()) return matches;
  const MatchFeatures& features = options.features;
  map_channels.cover(used);
  const cv::Point offset = map_channels.inside(map_offset);
  const BothScales pictures{quantized_channels(frame.image, frame.mask, features.fine, features.channels),
                            map_channels.channels(), map_channels.half(), offset};
  const auto places = patch_rectangles(frame, camera, pose, options, surface, pictures.even);
  matches.tried = static_cast<int>(places.size());
  for (const cv::Rect& place : places) {
    if (const auto match = match_one(pictures, place, frame.grid, options)) {
      matches.found.push_back(*match);
    }
  }
  return matches;
}

PatchMatches match_patches(const RectifiedFrame& frame, const CameraModel& camera, const CameraPose& pose,
                           const MapWindow& map, const PatchOptions& options, const GroundSurface& surface) {
  MapChannels channels(map.image, map.mask, options.features.fine, options.features.channels);
  return match_patches(frame, camera, pose, map, channels, options, surface);
}

}  // namespace nadir
