#include "estimation/two_view_motion.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "vision/robust_gauss_newton.hpp"

namespace nadir {
namespace {

constexpr double kMinDownComponent = 0.2;  // of a ray: flatter ones see the horizon

constexpr double kMostIndependentSights = 100;  // whatever their residuals say
constexpr double kWorstFit = 5;                 // times what pixels and relief explain: these sights show no one motion
// Pictures turned so much farther than foretold are not pulled back: they show that the telemetry contradicts them.
constexpr double kFarTurn_rad = 0.4, kFarTurnSigmas = 4;

// Unknowns: east, north of the motion (m); log of the height ratio; change of heading; pitch and roll of the picture
// before and of the one now (rad), the last six as corrections of the prior.
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
std::optional<Eigen::Vector2d> hit(const CameraPose& pose, const Eigen::Matrix3d& enu_from_camera,
                                   const Eigen::Vector3d& ray, const Eigen::Vector2d& slope) {
  const Eigen::Vector3d direction = enu_from_camera * ray;
  const double down = -direction.z() + slope.dot(direction.head<2>());
  if (down < kMinDownComponent * direction.norm()) return std::nullopt;
  return Eigen::Vector2d(pose.position.east_m, pose.position.north_m) + pose.agl_m / down * direction.head<2>();
}

// Both poses with their rotations, which all sights share.
class Views {
 public:
  Views(const TwoViewPrior& prior, const Unknowns& u)
      : poses_(poses_at(prior, u)),
        before_(enu_from_camera(poses_.before.attitude)),
        now_(enu_from_camera(poses_.now.attitude)),
        slope_(prior.ground_slope) {}

  struct Hits {
    Eigen::Vector2d before, now;
  };
  // The two ground points that should be one.
  std::optional<Hits> hits(const RayPair& sight) const {
    const auto a = hit(poses_.before, before_, sight.ray_before, slope_);
    const auto b = hit(poses_.now, now_, sight.ray_now, slope_);
    if (!a || !b) return std::nullopt;
    return Hits{*a, *b};
  }
  std::optional<Eigen::Vector2d> gap(const RayPair& sight) const {
    const auto both = hits(sight);
    if (!both) return std::nullopt;
    return both->now - both->before;
  }

 private:
  Poses poses_;
  Eigen::Matrix3d before_, now_;
  Eigen::Vector2d slope_;
};

// The views a small step to both sides of every unknown but the motion, whose derivative is one.
class Neighbours {
 public:
  Neighbours(const TwoViewPrior& prior, const Unknowns& u) {
    for (int k = 2; k < 8; ++k) {
      for (const double step : {kStep, -kStep}) {
        Unknowns near = u;
        near[k] += step;
        views_.emplace_back(prior, near);
      }
    }
  }

  std::optional<Jacobian> jacobian_of(const RayPair& sight) const {
    Jacobian jacobian = Jacobian::Zero();
    jacobian(0, 0) = jacobian(1, 1) = 1;
    for (int k = 2; k < 8; ++k) {
      const auto ahead = static_cast<std::size_t>(2 * (k - 2));
      const auto a = views_[ahead].gap(sight), b = views_[ahead + 1].gap(sight);
      if (!a || !b) return std::nullopt;
      jacobian.col(k) = (*a - *b) / (2 * kStep);
    }
    return jacobian;
  }

 private:
  static constexpr double kStep = 1e-5;
  std::vector<Views> views_;
};

// How much farther clockwise the picture now is turned than the prior says.
double turn_beyond(const TwoViewPrior& prior, const std::vector<RayPair>& sights) {
  const Views views(prior, Unknowns::Zero());
  std::vector<Views::Hits> points;
  Eigen::Vector2d before = Eigen::Vector2d::Zero(), now = Eigen::Vector2d::Zero();
  for (const RayPair& sight : sights) {
    const auto both = views.hits(sight);
    if (!both) continue;
    points.push_back(*both);
    before += both->before;
    now += both->now;
  }
  const auto count = static_cast<double>(std::max<std::size_t>(1, points.size()));
  double along = 0, across = 0;
  for (const Views::Hits& point : points) {
    const Eigen::Vector2d a = point.before - before / count, b = point.now - now / count;
    along += a.dot(b);
    across += b.x() * a.y() - b.y() * a.x();
  }
  return -std::atan2(across, along);
}

Eigen::Vector2d median_gap(const TwoViewPrior& prior, const Unknowns& u, const std::vector<RayPair>& sights) {
  std::vector<double> east, north;
  const Views views(prior, u);
  for (const RayPair& sight : sights) {
    if (const auto g = views.gap(sight)) {
      east.push_back(g->x());
      north.push_back(g->y());
    }
  }
  if (east.empty()) return Eigen::Vector2d::Zero();
  const auto middle = [](std::vector<double>& v) {
    std::nth_element(v.begin(), v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2), v.end());
    return v[v.size() / 2];
  };
  return {middle(east), middle(north)};
}

Information prior_information(const TwoViewPrior& prior) {
  Information information = Information::Zero();
  information(2, 2) = 1 / (prior.log_height_sigma * prior.log_height_sigma);
  information(3, 3) = 1 / (prior.heading_sigma_rad * prior.heading_sigma_rad);
  information.bottomRightCorner<4, 4>() = prior.tilt_covariance_rad2.inverse();
  return information;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

std::optional<TwoViewMotion> solve_two_view_motion(const std::vector<RayPair>& sights, const TwoViewPrior& prior) {
  if (sights.size() < 6) return std::nullopt;
  const double least_sigma_m = 0.0015 * prior.now.agl_m;  // about a pixel of the working size
  Information from_prior = prior_information(prior);
  Unknowns u = Unknowns::Zero();
  const double turn_rad = turn_beyond(prior, sights);
  if (std::abs(turn_rad) > std::max(kFarTurn_rad, kFarTurnSigmas * prior.heading_sigma_rad)) {
    u[3] = turn_rad;
    from_prior(3, 3) = 1 / (std::numbers::pi * std::numbers::pi);
  }
  u.head<2>() = -median_gap(prior, u, sights);
  TwoViewMotion motion;
  Information information = Information::Zero();
  double explained_m = least_sigma_m;   // by the picture's resolution and the ground's relief
  double sigma_m = 30 * least_sigma_m;  // graduated: begin nearly convex, end at what the residuals show
  // Neighbouring features err alike (relief, rolling shutter): how many count as one is seen when the rest is settled.
  double crowd = std::max(1.0, static_cast<double>(sights.size()) / kMostIndependentSights);
  bool crowd_known = false;
  for (int iteration = 0; iteration < 30; ++iteration) {
    information = from_prior;
    Unknowns gradient = -(from_prior * u);
    motion.inliers = 0;
    const double scale_m = 3 * sigma_m;
    std::vector<double> residuals_m;
    std::vector<Eigen::Vector2d> places, residuals;
    const Views here(prior, u);
    const Neighbours neighbours(prior, u);
    for (const RayPair& sight : sights) {
      const auto residual = here.gap(sight);
      const auto jacobian = neighbours.jacobian_of(sight);
      if (!residual || !jacobian) return std::nullopt;
      const double squared = residual->squaredNorm();
      residuals_m.push_back(std::sqrt(squared));
      const double shrink = scale_m * scale_m / (scale_m * scale_m + squared);
      const double weight = shrink * shrink / (sigma_m * sigma_m * crowd);
      information += weight * jacobian->transpose() * *jacobian;
      gradient -= weight * jacobian->transpose() * *residual;
      if (squared < scale_m * scale_m) {
        ++motion.inliers;
        places.emplace_back(sight.ray_now.x(), sight.ray_now.y());
        residuals.push_back(*residual);
      }
    }
    const Unknowns step = information.ldlt().solve(gradient);
    if (!step.allFinite() || step.tail<6>().cwiseAbs().maxCoeff() > 1) return std::nullopt;
    u += step;
    explained_m = std::max(least_sigma_m, prior.relief_sigma_m * u.head<2>().norm() / prior.now.agl_m);
    const double seen_sigma_m = std::max(explained_m, median(residuals_m) / 1.177);
    const bool settled = step.head<2>().norm() < 1e-4 && step.tail<6>().norm() < 1e-6;
    if (settled && sigma_m <= 1.01 * seen_sigma_m) {
      if (crowd_known) break;
      const double independent = std::min(kMostIndependentSights, effective_sample_size(places, residuals));
      crowd = std::max(1.0, static_cast<double>(motion.inliers) / independent);
      crowd_known = true;
    }
    sigma_m = std::max(seen_sigma_m, 0.6 * sigma_m);
  }
  if (sigma_m > kWorstFit * explained_m) return std::nullopt;
  const Information covariance = information.inverse();
  motion.solved = u;
  motion.measurement_information = information - from_prior;
  motion.measurement_gradient = from_prior * u;
  motion.moved_m = u.head<2>();
  motion.covariance_m2 = covariance.topLeftCorner<2, 2>();
  motion.turn_rad = prior.now.attitude.heading_rad + u[3] - prior.before.attitude.heading_rad;
  return motion;
}

}  // namespace nadir
