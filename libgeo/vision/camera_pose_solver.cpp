#include "vision/camera_pose_solver.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>

namespace nadir {
namespace {

// Unknowns: east, north (m), log height, heading, pitch, roll (rad), slope of the ground to the east and to the north.
constexpr int kUnknowns = 8;
using Vector = Eigen::Matrix<double, kUnknowns, 1>;
using Matrix = Eigen::Matrix<double, kUnknowns, kUnknowns>;
using Jacobian = Eigen::Matrix<double, 2, kUnknowns>;

constexpr int kIterations = 25;
constexpr double kMinDownComponent = 0.2;  // of a ray: flatter ones see the horizon

struct Scene {
  CameraPose pose;
  Eigen::Vector2d slope = Eigen::Vector2d::Zero();
};

Scene moved(const Scene& scene, const Vector& step) {
  Scene result = scene;
  result.pose.position.east_m += step[0];
  result.pose.position.north_m += step[1];
  result.pose.agl_m *= std::exp(step[2]);
  result.pose.attitude.heading_rad += step[3];
  result.pose.attitude.pitch_rad += step[4];
  result.pose.attitude.roll_rad += step[5];
  result.slope += step.tail<2>();
  return result;
}

// Where the ray meets the sloping ground at the sight's height.
std::optional<Eigen::Vector2d> hit(const Scene& scene, const Eigen::Matrix3d& rotation, const GroundCorrespondence& sight) {
  const Eigen::Vector3d direction = rotation * sight.ray;
  const double down = -direction.z() + scene.slope.dot(direction.head<2>());
  if (down < kMinDownComponent * direction.norm()) return std::nullopt;
  const double along = (scene.pose.agl_m - sight.height_m) / down;
  return Eigen::Vector2d(scene.pose.position.east_m, scene.pose.position.north_m) + along * direction.head<2>();
}

// A scene with its rotation, and the scenes a small step to both sides of every unknown: central differences, because
// cheap projections are clearer than the closed form and exact to 1e-9 here.
class Linearised {
 public:
  explicit Linearised(const Scene& scene) : here_{scene, enu_from_camera(scene.pose.attitude)} {
    for (int k = 2; k < kUnknowns; ++k) {
      for (const double sign : {1.0, -1.0}) {
        Vector change = Vector::Zero();
        change[k] = sign * kStep;
        const Scene near = moved(scene, change);
        near_.push_back({near, enu_from_camera(near.pose.attitude)});
      }
    }
  }

  std::optional<Eigen::Vector2d> hit_of(const GroundCorrespondence& sight) const {
    return hit(here_.scene, here_.rotation, sight);
  }

  std::optional<Jacobian> jacobian_of(const GroundCorrespondence& sight) const {
    Jacobian jacobian = Jacobian::Zero();
    jacobian(0, 0) = jacobian(1, 1) = 1;
    for (int k = 2; k < kUnknowns; ++k) {
      const Oriented& up = near_[static_cast<std::size_t>(2 * (k - 2))];
      const Oriented& down = near_[static_cast<std::size_t>(2 * (k - 2) + 1)];
      const auto ahead = hit(up.scene, up.rotation, sight), behind = hit(down.scene, down.rotation, sight);
      if (!ahead || !behind) return std::nullopt;
      jacobian.col(k) = (*ahead - *behind) / (2 * kStep);
    }
    return jacobian;
  }

 private:
  static constexpr double kStep = 1e-5;
  struct Oriented {
    Scene scene;
    Eigen::Matrix3d rotation;
  };
  Oriented here_;
  std::vector<Oriented> near_;
};

Eigen::Matrix2d information_of(const GroundCorrespondence& sight, const SolverOptions& options) {
  const Eigen::Matrix2d floor = Eigen::Matrix2d::Identity() * (options.min_sigma_m * options.min_sigma_m);
  return (sight.information_m2.inverse() + floor).inverse();
}

struct Normal {
  Matrix information = Matrix::Zero();
  Vector gradient = Vector::Zero();
};

// Prior terms on height, heading, tilt and slope as seen from the present scene.
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

// What the sights say once the priors on the pose are taken away; the one on the slope stays.
void tell_sighted(SolvedPose& solved, const Scene& scene, const Matrix& information, const PosePrior& prior) {
  const Normal from_prior = prior_terms(scene, prior);
  // Where the whole is settled, the sights pull exactly against the priors.
  Matrix sights = information;
  sights.topLeftCorner<6, 6>() -= from_prior.information.topLeftCorner<6, 6>();
  const Vector pull = -from_prior.gradient;
  const Eigen::Matrix<double, 6, 2> with_slope = sights.topRightCorner<6, 2>();
  const Eigen::Matrix2d slope = sights.bottomRightCorner<2, 2>().inverse();
  solved.sighted_information = sights.topLeftCorner<6, 6>() - with_slope * slope * with_slope.transpose();
  solved.sighted_pull = pull.head<6>();
}

}  // namespace

std::optional<SolvedPose> solve_camera_pose(const std::vector<GroundCorrespondence>& sights, const PosePrior& prior,
                                            const SolverOptions& options) {
  if (sights.size() < 4) return std::nullopt;
  SolvedPose solved;
  Scene scene{prior.pose};
  Normal total;
  double scale_m = 4 * options.inlier_m;  // graduated: begin nearly convex, end at the inlier bound
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    total = prior_terms(scene, prior);
    const Linearised here(scene);
    solved.inlier.assign(sights.size(), false);
    solved.residual_m.resize(sights.size());
    solved.inliers = 0;
    double squares = 0;
    for (std::size_t i = 0; i < sights.size(); ++i) {
      const auto at = here.hit_of(sights[i]);
      const auto jacobian = here.jacobian_of(sights[i]);
      if (!at || !jacobian) return std::nullopt;
      const Eigen::Vector2d residual = Eigen::Vector2d(sights[i].ground.east_m, sights[i].ground.north_m) - *at;
      solved.residual_m[i] = residual;
      const double squared = residual.squaredNorm();
      const double shrink = scale_m * scale_m / (scale_m * scale_m + squared);
      const Eigen::Matrix2d weight = shrink * shrink * information_of(sights[i], options);
      total.information += jacobian->transpose() * weight * *jacobian;
      total.gradient += jacobian->transpose() * weight * residual;
      if (squared <= options.inlier_m * options.inlier_m) {
        solved.inlier[i] = true;
        ++solved.inliers;
        squares += squared;
      }
    }
    solved.rms_m = solved.inliers > 0 ? std::sqrt(squares / solved.inliers) : 0;
    const Vector step = total.information.ldlt().solve(total.gradient);
    if (!step.allFinite() || step.tail<6>().cwiseAbs().maxCoeff() > 1.0) return std::nullopt;
    scene = moved(scene, step);
    const bool settled = step.head<2>().norm() < 1e-4 && step.tail<6>().norm() < 1e-6;
    if (settled && scale_m <= options.inlier_m) break;
    scale_m = std::max(options.inlier_m, scale_m * 0.7);
  }
  solved.pose = scene.pose;
  solved.covariance = total.information.inverse().topLeftCorner<6, 6>();
  tell_sighted(solved, scene, total.information, prior);
  return solved;
}

}  // namespace nadir
