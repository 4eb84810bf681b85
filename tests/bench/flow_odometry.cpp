#include "flow_odometry.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>

#include "vision/correlation.hpp"
#include "vision/patch_matching.hpp"

namespace nadir {
namespace {

constexpr double kCoarseFootprint_px = 110;  // longer side of the image for the first, coarse alignment
constexpr double kLeastOverlap = 0.25;       // of the image: less is not evaluated
constexpr double kMinScore = 0.18;           // of the coarse alignment, at most 1; images without overlap reach 0.15
constexpr double kHeadingStep_rad = 0.06;
constexpr double kMostTurn_rad = 0.5;     // beyond what the telemetry's heading says
constexpr double kLeastPatchScore = 0.4;  // the same light, the same season: stricter than against a map
constexpr double kAgreeingShare = 0.4;    // of the patches found: chance agreement stays far below

CameraPose pose_of(const OdometryFrame& frame) { return {{}, frame.agl_m, frame.attitude}; }

// The footprint as a grid whose lines all grids of this spacing share; nothing when the camera sees the horizon.
std::optional<GroundGrid> shared_grid(const CameraModel& camera, const CameraPose& pose, double gsd_m) {
  const auto box = footprint_of(camera, pose);
  if (!box) return std::nullopt;
  GroundGrid grid;
  grid.gsd_m = gsd_m;
  const double left = std::floor(box->west_m / gsd_m), top = std::ceil(box->north_m / gsd_m);
  grid.west_m = left * gsd_m;
  grid.north_m = top * gsd_m;
  grid.columns = static_cast<int>(std::ceil(box->east_m / gsd_m) - left);
  grid.rows = static_cast<int>(top - std::floor(box->south_m / gsd_m));
  return grid;
}

std::optional<RectifiedFrame> seen_from(const OdometryFrame& frame, const CameraPose& pose, double gsd_m) {
  const auto grid = shared_grid(frame.camera, pose, gsd_m);
  if (!grid) return std::nullopt;
  return rectify(reduce_frame(frame.grey, frame.camera, pose.agl_m, gsd_m), pose, *grid);
}

// The image before as a map for the one now, with room around it so that the one now may overhang.
MapWindow as_map(const RectifiedFrame& seen, int margin) {
  MapWindow map;
  cv::copyMakeBorder(seen.image, map.image, margin, margin, margin, margin, cv::BORDER_REPLICATE);
  cv::copyMakeBorder(seen.mask, map.mask, margin, margin, margin, margin, cv::BORDER_CONSTANT, cv::Scalar(0));
  map.gsd_m = seen.grid.gsd_m;
  map.west_m = seen.grid.west_m - margin * map.gsd_m;
  map.north_m = seen.grid.north_m + margin * map.gsd_m;
  return map;
}

// The coarse alignment: displacement, and turn beyond the telemetry's heading, to a pixel of the coarse images.
std::optional<CameraPose> coarse_alignment(const OdometryFrame& before, const OdometryFrame& now) {
  const double gsd_m = footprint_side_m(now.camera, now.agl_m) / kCoarseFootprint_px;
  const auto seen_before = seen_from(before, pose_of(before), gsd_m);
  if (!seen_before) return std::nullopt;
  const double range_rad = std::min(kMostTurn_rad, 2 * now.heading_sigma_rad);
  const int steps = static_cast<int>(std::max(0.0, std::ceil(range_rad / kHeadingStep_rad - 0.5)));
  std::optional<CameraPose> best;
  double best_score = kMinScore;
  for (int i = -steps; i <= steps; ++i) {
    CameraPose pose = pose_of(now);
    pose.attitude.heading_rad += i * kHeadingStep_rad;
    const auto seen_now = seen_from(now, pose, gsd_m);
    if (!seen_now) continue;
    const int margin = static_cast<int>((1 - kLeastOverlap) * std::max(seen_now->grid.columns, seen_now->grid.rows));
    const MapWindow map = as_map(*seen_before, margin);
    const Channels pattern = oriented_channels(seen_now->image, seen_now->mask, ChannelSet::double_angle);
    if (pattern.mask.cols > map.image.cols || pattern.mask.rows > map.image.rows) continue;
    const WindowSpectra window(oriented_channels(map.image, map.mask, ChannelSet::double_angle));
    const Peak peak = best_peak(correlate(pattern, window, TemplateNorm(pattern, window, kLeastOverlap)));
    if (peak.score <= best_score) continue;
    best_score = peak.score;
    best = pose;
    best->position = {map.west_m + peak.x * gsd_m - seen_now->grid.west_m,
                      map.north_m - peak.y * gsd_m - seen_now->grid.north_m};
  }
  return best;
}

// Patches of the image now, aligned for near where both poses say that they lie in the image before.
PixelPairs flow(const OdometryFrame& before, const CameraPose& pose_before, const OdometryFrame& now,
                const CameraPose& pose_now, double search_px) {
  PixelPairs pairs;
  const double gsd_m = gsd_at(now.camera, now.agl_m);
  const auto seen_before = seen_from(before, pose_before, gsd_m), seen_now = seen_from(now, pose_now, gsd_m);
  if (!seen_before || !seen_now) return pairs;
  PatchOptions options;
  options.patch_px = 32;
  options.columns = 14;
  options.rows = 10;
  options.search_px = search_px;
  options.min_score = kLeastPatchScore;
  const auto pixel = [](const CameraModel& camera, const CameraPose& pose, PlanePoint point) {
    const Eigen::Vector2d at = camera.pixel_from_point(camera_from_ground(pose, point));
    return cv::Point2f(static_cast<float>(at.x()), static_cast<float>(at.y()));
  };
  const MapWindow map = as_map(*seen_before, static_cast<int>(std::ceil(search_px)) + options.patch_px);
  for (const PatchMatch& match : match_patches(*seen_now, now.camera, pose_now, map, options).found) {
    pairs.before.push_back(pixel(before.camera, pose_before, match.on_map));
    pairs.now.push_back(pixel(now.camera, pose_now, match.in_frame));
  }
  return pairs;
}

std::optional<OdometryStep> step_between(const OdometryFrame& before, const OdometryFrame& now) {
  const auto aligned = coarse_alignment(before, now);
  if (!aligned) return std::nullopt;
  CameraPose pose_before = pose_of(before), pose_now = *aligned;
  std::optional<OdometryStep> step;
  for (const double search_px : {14.0, 5.0}) {
    const PixelPairs pairs = flow(before, pose_before, now, pose_now, search_px);
    const auto measured = measure_motion(before, now, pairs);
    if (!measured || measured->step.inliers < kAgreeingShare * static_cast<double>(pairs.now.size())) {
      return std::nullopt;
    }
    const Eigen::Matrix<double, 8, 1>& solved = measured->motion.solved;
    pose_before.attitude.pitch_rad = before.attitude.pitch_rad + solved[4];
    pose_before.attitude.roll_rad = before.attitude.roll_rad + solved[5];
    pose_now.position = {solved[0], solved[1]};
    pose_now.agl_m = now.agl_m * std::exp(solved[2]);
    pose_now.attitude = {now.attitude.heading_rad + solved[3], now.attitude.pitch_rad + solved[6],
                         now.attitude.roll_rad + solved[7]};
    step = measured->step;
  }
  return step;
}

class FlowOdometry final : public OdometryFrontEnd {
 public:
  std::optional<OdometryStep> track(const OdometryFrame& frame) override {
    OdometryFrame now = at_working_size(frame);
    if (now.grey.data == frame.grey.data) now.grey = frame.grey.clone();  // the caller's image may change
    std::optional<OdometryStep> step;
    if (last_) step = step_between(*last_, now);
    last_ = std::move(now);
    return step;
  }

  void reset() override { last_.reset(); }

 private:
  std::optional<OdometryFrame> last_;
};

}  // namespace

std::unique_ptr<OdometryFrontEnd> make_flow_odometry() { return std::make_unique<FlowOdometry>(); }

}  // namespace nadir
