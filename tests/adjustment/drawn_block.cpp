#include "drawn_block.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <map>

#include "geodesy/angles.hpp"

namespace nadir::test {
namespace {

Eigen::Vector3d normal3(Random& random, double x, double y, double z) {
  return {random.normal(0, x), random.normal(0, y), random.normal(0, z)};
}

CameraModel nominal_camera() {
  CameraModel camera;
  camera.width = 1200;
  camera.height = 900;
  camera.fx = camera.fy = 1000;
  camera.cx = 599.5;
  camera.cy = 449.5;
  camera.distortion = {-0.08, 0.03, 0.0005, -0.0003, 0};
  return camera;
}

void draw_calibration(Random random, const CalibrationPrior& prior, DrawnBlock& block) {
  block.nominal = block.camera = nominal_camera();
  const double scale = std::exp(random.normal(0, prior.focal_relative));
  block.camera.fx *= scale;
  block.camera.fy *= scale;
  for (std::size_t i = 0; i < 5; ++i) {
    block.camera.distortion[i] += random.normal(0, i == 2 || i == 3 ? prior.tangential : prior.radial);
  }
  block.boresight_rad = normal3(random, prior.boresight_rad, prior.boresight_rad, prior.boresight_rad);
  block.log_height_scale = random.normal(0, prior.height_scale);
}

void draw_frames(Random random, const DrawnBlockOptions& o, const GroundSurface& ground, DrawnBlock& block) {
  Eigen::Vector2d off(random.normal(0, o.start_offset_m), random.normal(0, o.start_offset_m));
  for (int strip = 0; strip < o.strips; ++strip) {
    for (int i = 0; i < o.frames_per_strip; ++i) {
      const bool back = strip % 2 == 1;
      CameraPose pose;
      pose.position = {strip * o.side_m + random.normal(0, 2),
                       (back ? o.frames_per_strip - 1 - i : i) * o.forward_m + random.normal(0, 2)};
      pose.attitude = {(back ? kPi : 0) + random.normal(0, 0.05), random.normal(0, 0.04), random.normal(0, 0.04)};
      const double up_m = o.agl_m + random.normal(0, 3);
      pose.agl_m = up_m - ground.height_m(pose.position);
      block.poses.push_back(pose);
      block.centres_m.emplace_back(pose.position.east_m, pose.position.north_m, up_m);

      AdjustmentFrame frame;
      const Eigen::Matrix3d noise =
          rotation_from_vector(normal3(random, o.tilt_sigma_rad, o.tilt_sigma_rad, o.heading_sigma_rad));
      const Eigen::Matrix3d measured =
          noise * enu_from_camera(pose.attitude) * rotation_from_vector(block.boresight_rad).transpose();
      frame.attitude = AttitudeMeasurement{attitude_from_matrix(measured), o.tilt_sigma_rad, o.heading_sigma_rad};
      frame.height = HeightMeasurement{pose.agl_m * std::exp(block.log_height_scale + random.normal(0, o.height_sigma)),
                                       o.height_sigma};
      off += Eigen::Vector2d(random.normal(), random.normal()) * (o.drift_share * o.forward_m);
      frame.pose.position = pose.position + off;
      frame.pose.agl_m = frame.height->agl_m;
      frame.pose.attitude = frame.attitude->attitude;
      block.frames.push_back(frame);
    }
  }
}

void draw_anchors(Random random, const DrawnBlockOptions& o, DrawnBlock& block) {
  for (std::size_t i = 0; o.anchor_every > 0 && i < block.frames.size();
       i += static_cast<std::size_t>(o.anchor_every)) {
    Eigen::Vector2d error(random.normal(0, o.anchor_sigma_m), random.normal(0, o.anchor_sigma_m));
    const bool wrong = random.chance(o.wrong_anchor_share);
    const double far_m = random.uniform(150, 600), azimuth = random.uniform(0, 2 * kPi);
    if (wrong) error += far_m * Eigen::Vector2d(std::sin(azimuth), std::cos(azimuth));
    block.anchors.push_back(
        {i, block.poses[i].position + error, o.anchor_sigma_m * o.anchor_sigma_m * Eigen::Matrix2d::Identity()});
    block.wrong.push_back(wrong);
  }
}

// Frames whose footprint may hold a place, by squares of the ground.
class FrameGrid {
 public:
  FrameGrid(const std::vector<Eigen::Vector3d>& centres, double cell_m) : cell_m_(cell_m) {
    for (std::size_t i = 0; i < centres.size(); ++i) cells_[key(centres[i].x(), centres[i].y())].push_back(i);
  }
  std::vector<std::size_t> near(double east_m, double north_m) const {
    std::vector<std::size_t> found;
    const auto [column, row] = key(east_m, north_m);
    for (long c = column - 1; c <= column + 1; ++c) {
      for (long r = row - 1; r <= row + 1; ++r) {
        const auto cell = cells_.find({c, r});
        if (cell != cells_.end()) found.insert(found.end(), cell->second.begin(), cell->second.end());
      }
    }
    std::sort(found.begin(), found.end());
    return found;
  }

 private:
  std::pair<long, long> key(double east_m, double north_m) const {
    return {std::lround(east_m / cell_m_), std::lround(north_m / cell_m_)};
  }
  double cell_m_;
  std::map<std::pair<long, long>, std::vector<std::size_t>> cells_;
};

void draw_points(Random random, const DrawnBlockOptions& o, const GroundSurface& ground, DrawnBlock& block) {
  const double reach_m = 0.75 * o.agl_m;  // of half a footprint's diagonal
  const FrameGrid grid(block.centres_m, 1.2 * reach_m);
  const auto wanted = static_cast<std::size_t>(o.points_per_frame) * block.frames.size();
  const double east_m = (o.strips - 1) * o.side_m, north_m = (o.frames_per_strip - 1) * o.forward_m;
  constexpr double cell_m = parameters::adjustment::kTerrainCorrelation_m;
  std::map<std::pair<long, long>, double> terrain_error_m;
  std::size_t observations = 0;
  for (std::size_t tries = 0; observations < wanted && tries < 40 * wanted; ++tries) {
    Eigen::Vector3d point(random.uniform(-0.5 * reach_m, east_m + 0.5 * reach_m),
                          random.uniform(-0.5 * reach_m, north_m + 0.5 * reach_m), 0);
    const std::pair cell(std::lround(point.x() / cell_m), std::lround(point.y() / cell_m));
    const auto [error, first_here] = terrain_error_m.try_emplace(cell, 0.0);
    if (first_here) error->second = random.normal(0, o.terrain_sigma_m);
    point.z() = ground.height_m({point.x(), point.y()}) + error->second + random.normal(0, o.relief_sigma_m);
    TiePoint tie;
    std::vector<std::size_t> seen = grid.near(point.x(), point.y());
    for (std::size_t i = seen.size(); i > 1; --i) {  // in any order, so that a cut track is no strip's
      std::swap(seen[i - 1], seen[static_cast<std::size_t>(random.integer(0, static_cast<int>(i) - 1))]);
    }
    for (const std::size_t frame : seen) {
      if (tie.observations.size() >= static_cast<std::size_t>(o.longest_track)) break;
      const Eigen::Vector3d p =
          enu_from_camera(block.poses[frame].attitude).transpose() * (point - block.centres_m[frame]);
      if (p.z() < 1 || p.head<2>().norm() > p.z()) continue;
      Eigen::Vector2d pixel = block.camera.pixel_from_point(p);
      pixel += o.observation_sigma_px * Eigen::Vector2d(random.normal(), random.normal());
      if (random.chance(o.wrong_observation_share)) {
        pixel += Eigen::Vector2d(random.uniform(-80, 80), random.uniform(-80, 80));
      }
      if (pixel.x() < 0 || pixel.y() < 0 || pixel.x() > block.camera.width - 1 || pixel.y() > block.camera.height - 1) {
        continue;
      }
      tie.observations.push_back({frame, pixel, o.observation_sigma_px});
    }
    if (tie.observations.size() < 2) continue;
    observations += tie.observations.size();
    block.points.push_back(std::move(tie));
    block.points_m.push_back(point);
  }
}

}  // namespace

double RollingGround::height_m(PlanePoint point) const {
  return amplitude_m_ * std::sin(point.east_m / 130) * std::cos(point.north_m / 170);
}

AdjustmentOptions DrawnBlock::options(const DrawnBlockOptions& drawn) const {
  AdjustmentOptions result;
  result.calibration = drawn.calibration;
  result.terrain_sigma_m = drawn.terrain_sigma_m;
  return result;
}

void DrawnBlock::add_to(BlockAdjustment& adjustment) const {
  for (const AdjustmentFrame& frame : frames) adjustment.add_frame(frame);
  for (const PositionAnchor& anchor : anchors) adjustment.add_anchor(anchor);
  for (const TiePoint& point : points) adjustment.add_tie_point(point);
}

DrawnBlock draw_block(Random random, const DrawnBlockOptions& options, const GroundSurface& ground) {
  DrawnBlock block;
  draw_calibration(random.fork("calibration"), options.calibration, block);
  draw_frames(random.fork("frames"), options, ground, block);
  draw_anchors(random.fork("anchors"), options, block);
  draw_points(random.fork("points"), options, ground, block);
  return block;
}

BlockErrors block_errors(const AdjustedBlock& adjusted, const DrawnBlock& truth) {
  BlockErrors errors;
  double squares = 0;
  for (std::size_t i = 0; i < adjusted.frames.size(); ++i) {
    const AdjustedFrame& frame = adjusted.frames[i];
    const Eigen::Vector3d error =
        Eigen::Vector3d(frame.pose.position.east_m, frame.pose.position.north_m, frame.up_m) - truth.centres_m[i];
    squares += error.head<2>().squaredNorm();
    errors.largest_m = std::max(errors.largest_m, error.head<2>().norm());
    if (!frame.covariance) continue;
    const Eigen::Matrix3d p = frame.covariance->topLeftCorner<3, 3>();
    errors.nees_3d += error.dot(p.llt().solve(error));
    errors.nees_2d += error.head<2>().dot(p.topLeftCorner<2, 2>().llt().solve(error.head<2>()));
    ++errors.frames;
  }
  errors.rms_m = std::sqrt(squares / static_cast<double>(adjusted.frames.size()));
  if (errors.frames > 0) {
    errors.nees_2d /= static_cast<double>(errors.frames);
    errors.nees_3d /= static_cast<double>(errors.frames);
  }
  return errors;
}

}  // namespace nadir::test
