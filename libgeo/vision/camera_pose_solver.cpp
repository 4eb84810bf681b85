#include "vision/camera_pose_solver.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

#include "vision/robust_gauss_newton.hpp"

namespace nadir {
namespace {

constexpr int kUnknowns = 8;
using Normal = NormalEquations<kUnknowns>;
using Vector = Normal::Vector;
using Matrix = Normal::Matrix;
using Jacobian = Normal::Jacobian;

struct Scene {
  CameraPose pose;
  Eigen::Vector2d slope = Eigen::Vector2d::Zero();
};

Scene moved(const Scene& scene, const Vector& step) {
  Scene result = scene;
  result.pose.position = scene.pose.position + step.head<2>();
  result.pose.agl_m *= std::exp(step[2]);
  result.pose.attitude.heading_rad += step[3];
  result.pose.attitude.pitch_rad += step[4];
  result.pose.attitude.roll_rad += step[5];
  result.slope += step.tail<2>();
  return result;
}

// A scene with its rotation, which all rays share.
struct Oriented {
  explicit Oriented(const Scene& at) : scene(at), rotation(enu_from_camera(at.pose.attitude)) {}

  std::optional<PlanePoint> predicted(const GroundCorrespondence& correspondence) const {
    return sloping_ground_from_ray(scene.pose, rotation, correspondence.ray, scene.slope, correspondence.height_m);
  }

  Scene scene;
  Eigen::Matrix3d rotation;
};

// A scene, and the scenes a small step to both sides of every unknown but the position.
class Linearised {
 public:
  explicit Linearised(const Scene& scene) : here_(scene) {
    for (int k = 2; k < kUnknowns; ++k) {
      for (const double sign : {1.0, -1.0}) {
        Vector change = Vector::Zero();
        change[k] = sign * kJacobianStep;
        near_.emplace_back(moved(scene, change));
      }
    }
  }

  std::optional<PlanePoint> predicted(const GroundCorrespondence& correspondence) const {
    return here_.predicted(correspondence);
  }

  std::optional<Jacobian> jacobian_of(const GroundCorrespondence& correspondence) const {
    const auto ahead = [&](int k) { return near_[static_cast<std::size_t>(2 * (k - 2))].predicted(correspondence); };
    const auto behind = [&](int k) {
      return near_[static_cast<std::size_t>(2 * (k - 2) + 1)].predicted(correspondence);
    };
    return numeric_jacobian<kUnknowns>(ahead, behind);
  }

 private:
  Oriented here_;
  std::vector<Oriented> near_;
};

Eigen::Matrix2d information_of(const GroundCorrespondence& correspondence, const SolverOptions& options) {
  const Eigen::Matrix2d floor = Eigen::Matrix2d::Identity() * (options.min_sigma_m * options.min_sigma_m);
  return (correspondence.information_m2.inverse() + floor).inverse();
}

// Prior terms on height, heading, tilt and slope, linearised at the present scene.
Normal prior_terms(const Scene& scene, const PosePrior& prior) {
  const CameraPose& pose = scene.pose;
  Normal normal;
  normal.information(2, 2) = 1 / (prior.log_agl_sigma * prior.log_agl_sigma);
  normal.information(3, 3) = 1 / (prior.heading_sigma_rad * prior.heading_sigma_rad);
  normal.information.block<2, 2>(4, 4) = prior.tilt_covariance_rad2.inverse();
  normal.information(6, 6) = normal.information(7, 7) = 1 / (prior.slope_sigma * prior.slope_sigma);
  Vector off = Vector::Zero();
  off << 0, 0, std::log(pose.agl_m / prior.pose.agl_m), pose.attitude.heading_rad - prior.pose.attitude.heading_rad,
      pose.attitude.pitch_rad - prior.pose.attitude.pitch_rad, pose.attitude.roll_rad - prior.pose.attitude.roll_rad,
      scene.slope.x(), scene.slope.y();
  normal.gradient = -(normal.information * off);
  return normal;
}

// See robust_gauss_newton().
class PoseProblem {
 public:
  PoseProblem(const std::vector<GroundCorrespondence>& correspondences, const PosePrior& prior,
              const SolverOptions& options)
      : correspondences_(correspondences),
        prior_(prior),
        options_(options),
        scene_{prior.pose},
        scale_m_(kPoseBeginScale * options.inlier_m) {}

  std::optional<Normal> linearize() {
    total_ = prior_terms(scene_, prior_);
    const Linearised here(scene_);
    solved_.inlier.assign(correspondences_.size(), false);
    solved_.residual_m.resize(correspondences_.size());
    solved_.inliers = 0;
    double squares = 0;
    for (std::size_t i = 0; i < correspondences_.size(); ++i) {
      const GroundCorrespondence& correspondence = correspondences_[i];
      const auto at = here.predicted(correspondence);
      const auto jacobian = here.jacobian_of(correspondence);
      if (!at || !jacobian) return std::nullopt;
      const Eigen::Vector2d residual = correspondence.ground - *at;
      solved_.residual_m[i] = residual;
      const double squared = residual.squaredNorm();
      const Eigen::Matrix2d weight = geman_mcclure_weight(squared, scale_m_) * information_of(correspondence, options_);
      total_.add(*jacobian, weight, residual);
      if (squared <= options_.inlier_m * options_.inlier_m) {
        solved_.inlier[i] = true;
        ++solved_.inliers;
        squares += squared;
      }
    }
    solved_.rms_m = solved_.inliers > 0 ? std::sqrt(squares / solved_.inliers) : 0;
    return total_;
  }

  void apply(const Vector& step) { scene_ = moved(scene_, step); }

  bool finished(bool converged) {
    if (converged && scale_m_ <= options_.inlier_m) return true;
    scale_m_ = std::max(options_.inlier_m, scale_m_ * kPoseNarrowing);
    return false;
  }

  SolvedPose solved() && {
    solved_.pose = scene_.pose;
    const Matrix covariance = total_.information.inverse();
    solved_.covariance = covariance.topLeftCorner<6, 6>();
    const Eigen::Matrix2d with_slope = covariance.topRightCorner<2, 2>();
    solved_.slope_covariance_m2 = with_slope * with_slope.transpose() / (prior_.slope_sigma * prior_.slope_sigma);
    separate_measurements();
    return std::move(solved_);
  }

 private:
  // The information of the correspondences without the priors on the pose; the one on the slope stays. Where the
  // whole has converged, the measurements' gradient balances the priors'.
  void separate_measurements() {
    const Normal from_prior = prior_terms(scene_, prior_);
    Matrix measured = total_.information;
    measured.topLeftCorner<6, 6>() -= from_prior.information.topLeftCorner<6, 6>();
    const Vector pull = -from_prior.gradient;
    const Eigen::Matrix<double, 6, 2> with_slope = measured.topRightCorner<6, 2>();
    const Eigen::Matrix2d slope = measured.bottomRightCorner<2, 2>().inverse();
    solved_.measurement_information = measured.topLeftCorner<6, 6>() - with_slope * slope * with_slope.transpose();
    solved_.measurement_gradient = pull.head<6>();
  }

  const std::vector<GroundCorrespondence>& correspondences_;
  const PosePrior& prior_;
  const SolverOptions& options_;
  Scene scene_;
  double scale_m_;  // graduated: begin nearly convex, end at the inlier bound
  Normal total_;
  SolvedPose solved_;
};

}  // namespace

std::optional<SolvedPose> solve_camera_pose(const std::vector<GroundCorrespondence>& correspondences,
                                            const PosePrior& prior, const SolverOptions& options) {
  if (correspondences.size() < kMinCorrespondences) return std::nullopt;
  PoseProblem problem(correspondences, prior, options);
  if (!robust_gauss_newton(problem, kPoseIterations)) return std::nullopt;
  return std::move(problem).solved();
}

}  // namespace nadir
