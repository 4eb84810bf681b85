#include "adjustment/block_adjustment.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <functional>
#include <string>
#include <utility>

#include "adjustment/adjustment_run.hpp"
#include "base/error.hpp"

namespace nadir {
namespace {

namespace limits = parameters::adjustment;

[[noreturn]] void reject(const char* what, const std::string& where, const char* expected, const std::string& found) {
  throw UsageError({.what = what, .where = where, .expected = expected, .found = found, .fix = "correct the input"});
}

void require_positive(double value, const char* what, const std::string& where) {
  if (!(value > 0) || !std::isfinite(value)) reject(what, where, "a finite number above 0", fmt::format("{}", value));
}

void require_place(PlanePoint place, const char* what, const std::string& where) {
  if (!(std::abs(place.east_m) <= limits::kMaxPlane_m && std::abs(place.north_m) <= limits::kMaxPlane_m)) {
    reject(what, where, "metres from the plane's origin, at most 1000 km",
           fmt::format("{}, {}", place.east_m, place.north_m));
  }
}

void require_attitude(const Attitude& attitude, const std::string& where) {
  if (!std::isfinite(attitude.heading_rad) || !std::isfinite(attitude.pitch_rad) || !std::isfinite(attitude.roll_rad)) {
    reject("the attitude is not a number", where, "finite angles",
           fmt::format("{}, {}, {}", attitude.heading_rad, attitude.pitch_rad, attitude.roll_rad));
  }
}

FrameBlock block_from_pose(const CameraPose& pose, const GroundSurface& ground) {
  FrameBlock block;
  block.values = {pose.position.east_m, pose.position.north_m, ground.height_m(pose.position) + pose.agl_m, 0, 0, 0};
  block.reference = enu_from_camera(pose.attitude);
  return block;
}

}  // namespace

std::optional<Eigen::MatrixXd> AdjustedBlock::joint_covariance(const std::vector<std::size_t>& of) const {
  const auto size = static_cast<Eigen::Index>(6 * of.size());
  Eigen::MatrixXd joint(size, size);
  for (std::size_t i = 0; i < of.size(); ++i) {
    if (of[i] >= frames.size() || !frames[of[i]].covariance) return std::nullopt;
    const auto row = static_cast<Eigen::Index>(6 * i);
    joint.block<6, 6>(row, row) = *frames[of[i]].covariance;
    for (std::size_t j = 0; j < i; ++j) {
      const auto [last, first] = std::minmax(of[i], of[j], std::greater<>());
      const auto found =
          std::lower_bound(cross_covariances.begin(), cross_covariances.end(), std::pair(last, first),
                           [](const FrameCrossCovariance& c, const auto& key) { return std::pair(c.a, c.b) < key; });
      if (found == cross_covariances.end() || found->a != last || found->b != first) return std::nullopt;
      const PoseCovariance cross = last == of[i] ? found->covariance : PoseCovariance(found->covariance.transpose());
      const auto column = static_cast<Eigen::Index>(6 * j);
      joint.block<6, 6>(row, column) = cross;
      joint.block<6, 6>(column, row) = cross.transpose();
    }
  }
  return joint;
}

struct BlockAdjustment::Impl {
  BlockData data;
  BlockState state;
  std::size_t observations = 0;

  void require_frame(std::size_t frame, const std::string& where) const {
    if (frame >= data.frames.size()) {
      reject("there is no such frame", where, "the index of a frame that was added", fmt::format("{}", frame));
    }
  }
  void require_observation(const ImageObservation& o, const std::string& where) const {
    require_frame(o.frame, where);
    require_positive(o.sigma_px, "the sigma of an observation is impossible", where);
    const double w = data.camera.width, h = data.camera.height;
    // Also rejects what is not a number.
    if (!(o.pixel.x() >= -0.5 && o.pixel.x() <= w - 0.5 && o.pixel.y() >= -0.5 && o.pixel.y() <= h - 0.5)) {
      reject("an observation is outside of the image", where, "a pixel of the camera's image",
             fmt::format("{}, {} in {} x {}", o.pixel.x(), o.pixel.y(), w, h));
    }
  }
};

BlockAdjustment::BlockAdjustment(const CameraModel& camera, const GroundSurface& ground,
                                 const AdjustmentOptions& options) {
  require_positive(camera.fx, "the camera's fx is impossible", "camera");
  require_positive(camera.fy, "the camera's fy is impossible", "camera");
  require_positive(camera.width, "the camera's width is impossible", "camera");
  require_positive(camera.height, "the camera's height is impossible", "camera");
  for (const double value : {camera.cx, camera.cy, camera.distortion[0], camera.distortion[1], camera.distortion[2],
                             camera.distortion[3], camera.distortion[4]}) {
    if (!std::isfinite(value))
      reject("the camera model is not a number", "camera", "finite numbers", "NaN or infinity");
  }
  require_positive(options.terrain_sigma_m, "the terrain's sigma is impossible", "options");
  const CalibrationPrior& prior = options.calibration;
  for (const double value : {prior.focal_relative, prior.radial, prior.tangential, prior.boresight_rad,
                             prior.boresight_axis_rad(2), prior.height_scale, options.terrain_correlation_m}) {
    if (!(value >= 0) || !std::isfinite(value)) {
      reject("an option is impossible", "options", "a finite number, 0 or more", fmt::format("{}", value));
    }
  }
  impl_ = std::make_unique<Impl>(Impl{{camera, ground, options, AdjustableLens(camera), {}, {}, {}, {}}, {}});
  impl_->state.calibration.distortion = camera.distortion;
}

BlockAdjustment::~BlockAdjustment() = default;
BlockAdjustment::BlockAdjustment(BlockAdjustment&&) noexcept = default;
BlockAdjustment& BlockAdjustment::operator=(BlockAdjustment&&) noexcept = default;

std::size_t BlockAdjustment::add_frame(const AdjustmentFrame& frame) {
  BlockData& data = impl_->data;
  const std::size_t index = data.frames.size();
  const std::string where = fmt::format("frame {}", index);
  require_place(frame.pose.position, "the position is impossible", where);
  require_attitude(frame.pose.attitude, where);
  for (const double agl_m : {frame.pose.agl_m, frame.height ? frame.height->agl_m : frame.pose.agl_m}) {
    if (!(agl_m >= limits::kMinDepth_m && agl_m <= limits::kMaxAgl_m)) {
      reject("the height above ground is impossible", where, "1 to 30 000 m", fmt::format("{} m", agl_m));
    }
  }
  if (frame.attitude) {
    require_attitude(frame.attitude->attitude, where);
    require_positive(frame.attitude->tilt_sigma_rad, "the sigma of the tilt is impossible", where);
    require_positive(frame.attitude->heading_sigma_rad, "the sigma of the heading is impossible", where);
  }
  if (frame.height) require_positive(frame.height->relative_sigma, "the sigma of the height is impossible", where);
  const FrameBlock start = block_from_pose(frame.pose, data.ground);
  if (!start.centre_m().allFinite()) {
    reject("the ground has no height here", where, "a finite height", fmt::format("{} m", start.values[2]));
  }
  data.frames.push_back(frame);
  data.starts.push_back(start);
  impl_->state.frames.push_back(start);
  impl_->state.frame_states.push_back(FrameState::floating);
  impl_->state.covariances.emplace_back();
  return index;
}

std::size_t BlockAdjustment::add_anchor(const PositionAnchor& anchor) {
  const std::string where = fmt::format("anchor {} of frame {}", impl_->data.anchors.size(), anchor.frame);
  impl_->require_frame(anchor.frame, where);
  require_place(anchor.position, "the position is impossible", where);
  const Eigen::Matrix2d& covariance = anchor.covariance_m2;
  const bool symmetric = std::abs(covariance(0, 1) - covariance(1, 0)) <= 1e-6 * std::abs(covariance.trace());
  if (!covariance.allFinite() || !symmetric || covariance.llt().info() != Eigen::Success) {
    reject("the covariance is impossible", where, "a symmetric, positive definite matrix, m²",
           fmt::format("{} {}; {} {}", covariance(0, 0), covariance(0, 1), covariance(1, 0), covariance(1, 1)));
  }
  impl_->data.anchors.push_back({anchor.frame, anchor.position, covariance, std::nullopt});
  return impl_->data.anchors.size() - 1;
}

std::size_t BlockAdjustment::add_anchor(const PoseAnchor& anchor) {
  const std::string where = fmt::format("anchor {} of frame {}", impl_->data.anchors.size(), anchor.frame);
  impl_->require_frame(anchor.frame, where);
  require_place(anchor.pose.position, "the position is impossible", where);
  require_attitude(anchor.pose.attitude, where);
  require_positive(anchor.pose.agl_m, "the height above ground is impossible", where);
  const auto& covariance = anchor.covariance;
  const Eigen::Matrix<double, 6, 1> sigmas = covariance.diagonal().cwiseMax(0).cwiseSqrt();
  const bool symmetric =
      ((covariance - covariance.transpose()).cwiseAbs().array() <= 1e-6 * (sigmas * sigmas.transpose()).array()).all();
  if (!covariance.allFinite() || !symmetric || covariance.llt().info() != Eigen::Success) {
    reject("the covariance is impossible", where, "a symmetric, positive definite matrix of 6 x 6", "another one");
  }
  impl_->data.anchors.push_back({anchor.frame, anchor.pose.position, covariance.topLeftCorner<2, 2>(), anchor});
  return impl_->data.anchors.size() - 1;
}

std::size_t BlockAdjustment::add_tie_point(const TiePoint& point) {
  const std::size_t index = impl_->data.points.size();
  const std::string where = fmt::format("tie point {}", index);
  TiePoint added;
  added.control = point.control;
  for (const ImageObservation& o : point.observations) {
    impl_->require_observation(o, where);
    const bool repeated = std::any_of(added.observations.begin(), added.observations.end(),
                                      [&](const ImageObservation& other) { return other.frame == o.frame; });
    if (!repeated) added.observations.push_back(o);
  }
  if (point.control) {
    require_place(point.control->place, "the control point's place is impossible", where);
    require_positive(point.control->sigma_m, "the control point's sigma is impossible", where);
  }
  impl_->observations += added.observations.size();
  impl_->data.points.push_back(std::move(added));
  impl_->state.points.push_back(Eigen::Vector3d::Zero());
  impl_->state.point_known.push_back(false);
  return index;
}

void BlockAdjustment::add_observation(std::size_t tie_point, const ImageObservation& observation) {
  const std::string where = fmt::format("tie point {}", tie_point);
  if (tie_point >= impl_->data.points.size()) {
    reject("there is no such tie point", where, "the index of a tie point that was added",
           fmt::format("{}", tie_point));
  }
  impl_->require_observation(observation, where);
  auto& observations = impl_->data.points[tie_point].observations;
  const bool repeated = std::any_of(observations.begin(), observations.end(),
                                    [&](const ImageObservation& o) { return o.frame == observation.frame; });
  if (repeated) return;
  observations.push_back(observation);
  ++impl_->observations;
}

std::size_t BlockAdjustment::add_fix(std::size_t frame, const Eigen::Vector2d& pixel, PlanePoint place,
                                     double sigma_m) {
  TiePoint point;
  point.observations.push_back({frame, pixel, limits::kClickSigma_px});
  point.control = GroundControl{place, sigma_m};
  return add_tie_point(point);
}

std::size_t BlockAdjustment::frames() const { return impl_->data.frames.size(); }
std::size_t BlockAdjustment::observations() const { return impl_->observations; }

AdjustedBlock BlockAdjustment::adjust(Progress& progress, const Cancel& cancel) {
  return adjust({0, frames()}, progress, cancel);
}

AdjustedBlock BlockAdjustment::adjust(FrameWindow window, Progress& progress, const Cancel& cancel) {
  if (window.begin > window.end || window.end > frames()) {
    reject("the window is impossible", "block adjustment", "frames that were added",
           fmt::format("{} to {} of {}", window.begin, window.end, frames()));
  }
  BlockState state = impl_->state;
  AdjustedBlock block = run_adjustment(impl_->data, state, window, progress, cancel);
  impl_->state = std::move(state);
  return block;
}

}  // namespace nadir
