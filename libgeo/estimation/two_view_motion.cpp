#include "estimation/two_view_motion.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/quantile.hpp"
#include "vision/localizer_parameters.hpp"
#include "vision/robust_gauss_newton.hpp"

namespace nadir {
namespace {

using namespace parameters::two_view_motion;

// Unknowns: east, north of the displacement (m); log of the height ratio; change of heading; pitch and roll before and
// now (rad), the last six as corrections of the prior.
using Unknowns = Eigen::Matrix<double, 8, 1>;
using Information = Eigen::Matrix<double, 8, 8>;
using Jacobian = Eigen::Matrix<double, 2, 8>;

struct Poses {
  CameraPose before, now;
};

Poses poses_at(const TwoViewPrior& prior, const Unknowns& u) {
  Poses poses{prior.before, prior.now};
  poses.before.position = {};
  poses.before.attitude.pitch_rad += u[4];
  poses.before.attitude.roll_rad += u[5];
  poses.now.position = {u[0], u[1]};
  poses.now.agl_m *= std::exp(u[2]);
  poses.now.attitude.heading_rad += u[3];
  poses.now.attitude.pitch_rad += u[6];
  poses.now.attitude.roll_rad += u[7];
  return poses;
}

// Where a ray meets the sloping plane.
std::optional<Eigen::Vector2d> ground_point(const CameraPose& pose, const Eigen::Matrix3d& enu_from_camera,
                                            const Eigen::Vector3d& ray, const Eigen::Vector2d& slope) {
  const Eigen::Vector3d direction = enu_from_camera * ray;
  const double down = -direction.z() + slope.dot(direction.head<2>());
  if (down < kMinDownComponent * direction.norm()) return std::nullopt;
  return Eigen::Vector2d(pose.position.east_m, pose.position.north_m) + pose.agl_m / down * direction.head<2>();
}

// Both poses with their rotations, shared by all ray pairs.
class Views {
 public:
  Views(const TwoViewPrior& prior, const Unknowns& u)
      : poses_(poses_at(prior, u)),
        before_(enu_from_camera(poses_.before.attitude)),
        now_(enu_from_camera(poses_.now.attitude)),
        slope_(prior.ground_slope) {}

  struct GroundPoints {
    Eigen::Vector2d before, now;
  };
  // The two ground points that should coincide.
  std::optional<GroundPoints> ground_points(const RayPair& pair) const {
    const auto a = ground_point(poses_.before, before_, pair.ray_before, slope_);
    const auto b = ground_point(poses_.now, now_, pair.ray_now, slope_);
    if (!a || !b) return std::nullopt;
    return GroundPoints{*a, *b};
  }
  std::optional<Eigen::Vector2d> separation(const RayPair& pair) const {
    const auto both = ground_points(pair);
    if (!both) return std::nullopt;
    return both->now - both->before;
  }

 private:
  Poses poses_;
  Eigen::Matrix3d before_, now_;
  Eigen::Vector2d slope_;
};

// The views a small step to both sides of every unknown but the displacement, whose derivative is one.
class Neighbours {
 public:
  Neighbours(const TwoViewPrior& prior, const Unknowns& u) {
    for (int k = 2; k < 8; ++k) {
      for (const double step : {kJacobianStep, -kJacobianStep}) {
        Unknowns near = u;
        near[k] += step;
        views_.emplace_back(prior, near);
      }
    }
  }

  std::optional<Jacobian> jacobian_of(const RayPair& pair) const {
    const auto view = [this](int k) { return static_cast<std::size_t>(2 * (k - 2)); };
    return numeric_jacobian<8>([&](int k) { return views_[view(k)].separation(pair); },
                               [&](int k) { return views_[view(k) + 1].separation(pair); });
  }

 private:
  std::vector<Views> views_;
};

// How much farther clockwise the current image is turned than in the prior.
double turn_beyond(const TwoViewPrior& prior, const std::vector<RayPair>& pairs) {
  const Views views(prior, Unknowns::Zero());
  std::vector<Views::GroundPoints> points;
  Eigen::Vector2d before = Eigen::Vector2d::Zero(), now = Eigen::Vector2d::Zero();
  for (const RayPair& pair : pairs) {
    const auto both = views.ground_points(pair);
    if (!both) continue;
    points.push_back(*both);
    before += both->before;
    now += both->now;
  }
  const auto count = static_cast<double>(std::max<std::size_t>(1, points.size()));
  double along = 0, across = 0;
  for (const Views::GroundPoints& point : points) {
    const Eigen::Vector2d a = point.before - before / count, b = point.now - now / count;
    along += a.dot(b);
    across += b.x() * a.y() - b.y() * a.x();
  }
  return -std::atan2(across, along);
}

Eigen::Vector2d median_separation(const TwoViewPrior& prior, const Unknowns& u, const std::vector<RayPair>& pairs) {
  std::vector<double> east, north;
  const Views views(prior, u);
  for (const RayPair& pair : pairs) {
    if (const auto g = views.separation(pair)) {
      east.push_back(g->x());
      north.push_back(g->y());
    }
  }
  if (east.empty()) return Eigen::Vector2d::Zero();
  return {median(east), median(north)};
}

Information prior_information(const TwoViewPrior& prior) {
  Information information = Information::Zero();
  information(2, 2) = 1 / (prior.log_height_sigma * prior.log_height_sigma);
  information(3, 3) = 1 / (prior.heading_sigma_rad * prior.heading_sigma_rad);
  information.bottomRightCorner<4, 4>() = prior.tilt_covariance_rad2.inverse();
  return information;
}

// The robust Gauss-Newton problem. The scale of the kernel is graduated: it begins where the cost is nearly convex and
// ends at what the residuals show. Then, once, the number of independent ray pairs is estimated from the residuals
// (neighbouring features share errors: relief, rolling shutter), and the iteration settles again.
class TwoViewProblem {
 public:
  TwoViewProblem(const std::vector<RayPair>& pairs, const TwoViewPrior& prior)
      : pairs_(pairs),
        prior_(prior),
        prior_information_(prior_information(prior)),
        least_sigma_m_(kPixelHeightShare * prior.now.agl_m),
        explained_m_(least_sigma_m_),
        sigma_m_(kFirstScalePixels * least_sigma_m_),
        redundancy_(std::max(prior.redundancy, static_cast<double>(pairs.size()) / kMaxIndependentPairs)) {
    const double turn_rad = turn_beyond(prior, pairs);
    if (std::abs(turn_rad) > std::max(kFarTurn_rad, kFarTurnSigmas * prior.heading_sigma_rad)) {
      u_[3] = turn_rad;
      prior_information_(3, 3) = 1 / (std::numbers::pi * std::numbers::pi);
    }
    u_.head<2>() = -median_separation(prior, u_, pairs);
  }

  std::optional<NormalEquations<8>> linearize() {
    NormalEquations<8> normal{prior_information_, -(prior_information_ * u_)};
    inliers_ = 0;
    const double scale_m = kInlierSigmas * sigma_m_;
    residuals_m_.clear();
    inlier_positions_.clear();
    inlier_residuals_.clear();
    const Views here(prior_, u_);
    const Neighbours neighbours(prior_, u_);
    for (const RayPair& pair : pairs_) {
      const auto separation = here.separation(pair);
      const auto jacobian = neighbours.jacobian_of(pair);
      if (!separation || !jacobian) return std::nullopt;
      const double squared = separation->squaredNorm();
      residuals_m_.push_back(std::sqrt(squared));
      const double weight = geman_mcclure_weight(squared, scale_m) / (sigma_m_ * sigma_m_ * redundancy_);
      normal.add(*jacobian, weight, -*separation);
      if (squared < scale_m * scale_m) {
        ++inliers_;
        inlier_positions_.emplace_back(pair.ray_now.x(), pair.ray_now.y());
        inlier_residuals_.push_back(*separation);
      }
    }
    information_ = normal.information;
    return normal;
  }

  void apply(const Unknowns& step) { u_ += step; }

  bool finished(bool converged) {
    explained_m_ = std::max(least_sigma_m_, prior_.relief_sigma_m * u_.head<2>().norm() / prior_.now.agl_m);
    const double residual_sigma_m = std::max(explained_m_, median(residuals_m_) / kMedianOverSigma);
    if (converged && sigma_m_ <= kScaleSlack * residual_sigma_m) {
      if (redundancy_known_) return true;
      const double independent =
          std::min(kMaxIndependentPairs, effective_sample_size(inlier_positions_, inlier_residuals_));
      redundancy_ = std::max(prior_.redundancy, static_cast<double>(inliers_) / independent);
      redundancy_known_ = true;
    }
    sigma_m_ = std::max(residual_sigma_m, kScaleShrink * sigma_m_);
    return false;
  }

  // Nothing when the residuals show that no single motion explains the pairs.
  std::optional<TwoViewMotion> result() const {
    if (sigma_m_ > kMaxResidualRatio * explained_m_) return std::nullopt;
    const Information covariance = information_.inverse();
    TwoViewMotion motion;
    motion.inliers = inliers_;
    motion.solved = u_;
    motion.measurement_information = information_ - prior_information_;
    motion.measurement_gradient = prior_information_ * u_;
    motion.displacement_m = u_.head<2>();
    motion.covariance_m2 = covariance.topLeftCorner<2, 2>();
    motion.turn_rad = prior_.now.attitude.heading_rad + u_[3] - prior_.before.attitude.heading_rad;
    return motion;
  }

 private:
  const std::vector<RayPair>& pairs_;
  const TwoViewPrior& prior_;
  Unknowns u_ = Unknowns::Zero();
  Information prior_information_;
  Information information_ = Information::Zero();
  double least_sigma_m_;
  double explained_m_;  // residual that the image's resolution and the ground's relief explain
  double sigma_m_;      // of the kernel
  double redundancy_;   // how many ray pairs count as one
  bool redundancy_known_ = false;
  int inliers_ = 0;
  std::vector<double> residuals_m_;
  std::vector<Eigen::Vector2d> inlier_positions_, inlier_residuals_;
};

}  // namespace

std::optional<TwoViewMotion> solve_two_view_motion(const std::vector<RayPair>& pairs, const TwoViewPrior& prior) {
  if (pairs.size() < kMinRayPairs) return std::nullopt;
  TwoViewProblem problem(pairs, prior);
  if (!robust_gauss_newton(problem, kMaxIterations)) return std::nullopt;
  return problem.result();
}

}  // namespace nadir
