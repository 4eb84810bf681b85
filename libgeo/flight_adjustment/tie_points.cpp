#include "flight_adjustment/tie_points.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "adjustment/adjustment_parameters.hpp"
#include "flight_adjustment/tie_matching.hpp"
#include "geodesy/hypotenuse.hpp"

namespace nadir {
namespace {

using namespace parameters::ties;

// How far, in pixels, a feature may be from where the two poses expect it.
double reach_px(const CameraModel& camera, const TieFrame& a, const TieFrame& b, bool tracked) {
  const double side_px = std::max(camera.width, camera.height), height_m = std::min(a.pose.agl_m, b.pose.agl_m);
  // Of a step that odometry tracked, both positions err together.
  const double position_m = tracked ? kStepSigmaShare * distance_m(a.pose.position, b.pose.position)
                                    : hypotenuse(a.position_sigma_m, b.position_sigma_m);
  const double position_px = camera.fx * position_m / height_m;
  const double tilt_px = camera.fx * hypotenuse(a.tilt_sigma_rad, b.tilt_sigma_rad);
  const double turn_px = 0.5 * side_px * hypotenuse(a.heading_sigma_rad, b.heading_sigma_rad);
  const double scale_px = 0.5 * side_px * hypotenuse(a.log_height_sigma, b.log_height_sigma);
  const double sigma_px = hypotenuse(hypotenuse(position_px, tilt_px), hypotenuse(turn_px, scale_px));
  return std::clamp(kReachSigmas * sigma_px, kLeastReach * side_px, kMostReach * side_px);
}

// Where the middle of a picture looks, on level ground.
PlanePoint looked_at(const CameraModel& camera, const CameraPose& pose) {
  const auto ground = ground_from_ray(pose, camera.ray_from_pixel({camera.cx, camera.cy}));
  return ground ? *ground : pose.position;
}

}  // namespace

std::vector<std::pair<std::size_t, std::size_t>> pairs_to_compare(const CameraModel& camera,
                                                                  std::span<const TieFrame> frames) {
  std::vector<PlanePoint> middles;
  std::map<std::pair<std::int64_t, std::int64_t>, std::vector<std::size_t>> cells;
  double largest_m = 1;
  for (const TieFrame& frame : frames) {
    middles.push_back(looked_at(camera, frame.pose));
    largest_m = std::max(largest_m, footprint_side_m(camera, frame.pose.agl_m));
  }
  const auto cell = [&](double at_m) { return static_cast<std::int64_t>(std::floor(at_m / largest_m)); };
  for (std::size_t i = 0; i < frames.size(); ++i) {
    cells[{cell(middles[i].east_m), cell(middles[i].north_m)}].push_back(i);
  }
  std::vector<std::pair<std::size_t, std::size_t>> pairs;
  std::vector<std::pair<double, std::size_t>> near;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    for (std::size_t j = i + 1; j < std::min(frames.size(), i + 1 + kNextFrames); ++j) pairs.emplace_back(i, j);
    // Other passes: frames before this one that looked at about the same ground, each pair once.
    std::vector<std::size_t> others;
    for (std::int64_t east = -1; east <= 1; ++east) {
      for (std::int64_t north = -1; north <= 1; ++north) {
        const auto found = cells.find({cell(middles[i].east_m) + east, cell(middles[i].north_m) + north});
        if (found == cells.end()) continue;
        for (const std::size_t j : found->second) {
          const double most_m =
              kOverlapShare * footprint_side_m(camera, std::min(frames[i].pose.agl_m, frames[j].pose.agl_m));
          if (j + kNextFrames < i && distance_m(middles[i], middles[j]) <= most_m) others.push_back(j);
        }
      }
    }
    std::sort(others.begin(), others.end());
    near.clear();
    for (std::size_t begin = 0; begin < others.size();) {
      std::size_t end = begin + 1;
      while (end < others.size() && others[end] <= others[end - 1] + kPassGap) ++end;
      const auto nearest =
          std::min_element(others.begin() + static_cast<std::ptrdiff_t>(begin),
                           others.begin() + static_cast<std::ptrdiff_t>(end), [&](std::size_t a, std::size_t b) {
                             return distance_m(middles[i], middles[a]) < distance_m(middles[i], middles[b]);
                           });
      near.emplace_back(distance_m(middles[i], middles[*nearest]), *nearest);
      begin = end;
    }
    std::sort(near.begin(), near.end());
    for (std::size_t n = 0; n < std::min(near.size(), kPassesPerFrame); ++n) pairs.emplace_back(near[n].second, i);
  }
  std::sort(pairs.begin(), pairs.end());
  return pairs;
}

TiePoints find_tie_points(const CameraModel& full, const GroundSurface& ground, std::span<const TieFrame> frames,
                          const FrameImageOf& image_of, Progress& progress, const Cancel& cancel) {
  TiePoints result;
  result.camera = tie_camera(full);
  const CameraModel& camera = result.camera;
  progress.begin("tie points", 2 * frames.size(), "frames");
  std::vector<TieView> views;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    cancel.check();
    views.push_back(tie_view(tie_features(image_of(i), camera), camera, frames[i].pose, ground));
    progress.advance();
  }
  std::vector<TiePair> matched;
  std::size_t advanced = 0;
  for (const auto& [a, b] : pairs_to_compare(camera, frames)) {
    cancel.check();
    for (; advanced < a; ++advanced) progress.advance();
    bool tracked = b - a <= kNextFrames;
    for (std::size_t i = a + 1; i <= b && tracked; ++i) tracked = frames[i].continues_flight;
    ++result.pairs_compared;
    TiePair pair{a, b, match_ties(views[a], views[b], camera, ground, reach_px(camera, frames[a], frames[b], tracked))};
    pair.matches = agreeing_ties(views[a], views[b], camera, ground.relief_sigma_m(), pair.matches);
    if (pair.matches.empty()) continue;
    ++result.pairs_matched;
    matched.push_back(std::move(pair));
  }
  std::vector<std::size_t> counts;
  std::vector<std::vector<cv::Point2f>> points;
  for (TieView& view : views) {
    counts.push_back(view.features.size());
    points.push_back(std::move(view.features.points));
  }
  const auto tracks = well_spread(tie_tracks(counts, matched), points, {camera.width, camera.height});
  for (const TieTrack& track : tracks) {
    auto& observations = result.points.emplace_back();
    for (const TieObservation& o : track) {
      const cv::Point2f& at = points[o.frame][o.feature];
      observations.push_back({o.frame, {at.x, at.y}});
    }
  }
  progress.end();
  return result;
}

}  // namespace nadir
