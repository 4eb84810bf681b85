#include "adjustment/object_place.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "adjustment/residuals.hpp"
#include "base/error.hpp"
#include "geodesy/angles.hpp"
#include "vision/ground_ray.hpp"

namespace nadir {
namespace {

namespace table = parameters::adjustment;
using Vector3 = Eigen::Vector3d;

// Products and eigenvectors of matrices of any size, compiled once: Eigen's own are instantiated for each pair of
// types, which takes a compiler most of a minute.
using View = Eigen::Ref<const Eigen::MatrixXd>;
Eigen::MatrixXd product(const View& a, const View& b) {
  Eigen::MatrixXd result(a.rows(), b.cols());
  result.noalias() = a * b;
  return result;
}

// Of a symmetric matrix, function(eigenvalue) in the place of each eigenvalue.
template <typename Function>
Eigen::MatrixXd with_eigenvalues(const View& symmetric, Function function) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(symmetric);
  Eigen::MatrixXd scaled = solver.eigenvectors();
  for (Eigen::Index i = 0; i < scaled.cols(); ++i) scaled.col(i) *= function(solver.eigenvalues()[i]);
  const Eigen::MatrixXd transposed = solver.eigenvectors().transpose();
  return product(scaled, transposed);
}

Vector3 centre_of(const CameraPose& pose, const GroundSurface& ground) {
  return {pose.position.east_m, pose.position.north_m, pose.agl_m + ground.height_m(pose.position)};
}

constexpr GroundMarch kMarch{.share = table::kMarchShare,
                             .least_m = table::kMarchLeast_m,
                             .most_m = table::kMarchMost_m,
                             .range_m = table::kMaxRange_m,
                             .bisections = table::kHitBisections};

// The first point of the ray on the ground.
std::variant<Vector3, LocationProblem> first_hit(const Vector3& centre, const Vector3& direction,
                                                 const GroundSurface& ground) {
  const auto hit = first_ground_point(centre, direction, ground, kMarch);
  if (hit) return *hit;
  return direction.z() >= 0 ? LocationProblem::above_horizon : LocationProblem::no_ground;
}

Eigen::Vector2d slope_of(const GroundSurface& ground, double east_m, double north_m) {
  constexpr double d = table::kSlopeBaseline_m;
  return {(ground.height_m({east_m + d, north_m}) - ground.height_m({east_m - d, north_m})) / (2 * d),
          (ground.height_m({east_m, north_m + d}) - ground.height_m({east_m, north_m - d})) / (2 * d)};
}

class ObjectAdjustment {
 public:
  ObjectAdjustment(const CameraModel& camera, const GroundSurface& ground, std::span<const SightedFrame> frames,
                   std::span<const ObjectSighting> sightings, double terrain_sigma_m)
      : camera_(camera),
        lens_(camera),
        ground_(ground),
        frames_(frames),
        sightings_(sightings),
        terrain_sigma_m_(terrain_sigma_m) {
    for (const SightedFrame& frame : frames) {
      centres_.push_back(centre_of(frame.pose, ground));
      attitudes_.push_back(enu_from_camera(frame.pose.attitude));
    }
  }

  std::variant<LocatedObject, LocationProblem> locate(const std::optional<Eigen::MatrixXd>& joint);

 private:
  Eigen::Index rows() const { return static_cast<Eigen::Index>(2 * sightings_.size()) + 1; }
  std::variant<Vector3, LocationProblem> start() const;
  bool linearize(const Vector3& at);
  Eigen::MatrixXd variance(const std::optional<Eigen::MatrixXd>& joint, bool common) const;
  void test(const Eigen::MatrixXd& weight, LocatedObject& object) const;

  const CameraModel& camera_;
  AdjustableLens lens_;
  const GroundSurface& ground_;
  std::span<const SightedFrame> frames_;
  std::span<const ObjectSighting> sightings_;
  double terrain_sigma_m_;
  std::vector<Vector3> centres_;
  std::vector<Eigen::Matrix3d> attitudes_;

  // At a point: residuals (pixels, and the height above ground), and their derivatives by the point and by the poses.
  Eigen::VectorXd residual_;
  Eigen::MatrixXd by_point_;
  std::vector<Eigen::Matrix<double, 2, 6>> by_pose_;
};

// Where the rays meet the ground, on average; of rays that all look above it, where they come closest to each other.
std::variant<Vector3, LocationProblem> ObjectAdjustment::start() const {
  Vector3 sum = Vector3::Zero();
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Vector3 right = Vector3::Zero();
  std::size_t hits = 0;
  LocationProblem problem = LocationProblem::no_ground;
  for (const ObjectSighting& s : sightings_) {
    const Vector3& centre = centres_[s.frame];
    const Vector3 direction = (attitudes_[s.frame] * camera_.ray_from_pixel(s.pixel)).normalized();
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - direction * direction.transpose();
    normal += across;
    right += across * centre;
    const auto hit = first_hit(centre, direction, ground_);
    if (const auto* at = std::get_if<Vector3>(&hit)) {
      sum += *at;
      ++hits;
    } else {
      problem = std::get<LocationProblem>(hit);
    }
  }
  if (hits > 0) return Vector3(sum / static_cast<double>(hits));
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> parallax(normal);
  if (parallax.eigenvalues()[0] < table::kMinParallax_rad * table::kMinParallax_rad) return problem;
  return Vector3(normal.inverse() * right);
}

// False when the point is not in front of every camera.
bool ObjectAdjustment::linearize(const Vector3& at) {
  residual_.resize(rows());
  by_point_.resize(rows(), 3);
  by_pose_.resize(sightings_.size());
  for (std::size_t i = 0; i < sightings_.size(); ++i) {
    const ObjectSighting& s = sightings_[i];
    const Eigen::Matrix3d camera_from_world = attitudes_[s.frame].transpose();
    const Vector3 p = camera_from_world * (at - centres_[s.frame]);
    if (!(p.z() > table::kMinDepth_m)) return false;
    Eigen::Matrix<double, 2, 3> by_camera;
    const auto row = static_cast<Eigen::Index>(2 * i);
    residual_.segment<2>(row) = lens_.project(p, 0, camera_.distortion.data(), &by_camera, nullptr, nullptr) - s.pixel;
    const Eigen::Matrix<double, 2, 3> by_world = by_camera * camera_from_world;
    by_point_.middleRows<2>(row) = by_world;
    by_pose_[i].leftCols<3>() = -by_world;
    by_pose_[i].rightCols<3>() = by_camera * skew(p);
  }
  const Eigen::Vector2d slope = slope_of(ground_, at.x(), at.y());
  residual_[rows() - 1] = at.z() - ground_.height_m({at.x(), at.y()});
  by_point_.bottomRows<1>() << -slope.x(), -slope.y(), 1;
  return true;
}

// Of the residuals. common: errors of different frames are the same error, in units of their sigmas.
Eigen::MatrixXd ObjectAdjustment::variance(const std::optional<Eigen::MatrixXd>& joint, bool common) const {
  const std::size_t count = sightings_.size();
  std::vector<PoseCovariance> roots;
  if (common) {
    for (const SightedFrame& frame : frames_) {
      roots.emplace_back(
          with_eigenvalues(frame.covariance, [](double value) { return std::sqrt(std::max(value, 0.0)); }));
    }
  }
  Eigen::MatrixXd v = Eigen::MatrixXd::Zero(rows(), rows());
  for (std::size_t i = 0; i < count; ++i) {
    const auto row = static_cast<Eigen::Index>(2 * i);
    for (std::size_t j = 0; j < count; ++j) {
      const std::size_t a = sightings_[i].frame, b = sightings_[j].frame;
      PoseCovariance between = PoseCovariance::Zero();
      if (joint) {
        between = joint->block<6, 6>(static_cast<Eigen::Index>(6 * a), static_cast<Eigen::Index>(6 * b));
      } else if (a == b) {
        between = frames_[a].covariance;
      } else if (common) {
        between = roots[a] * roots[b];
      }
      v.block<2, 2>(row, static_cast<Eigen::Index>(2 * j)) = by_pose_[i] * between * by_pose_[j].transpose();
    }
    v.block<2, 2>(row, row) += sightings_[i].sigma_px * sightings_[i].sigma_px * Eigen::Matrix2d::Identity();
  }
  v(rows() - 1, rows() - 1) = terrain_sigma_m_ * terrain_sigma_m_;
  return v;
}

// χ² by Wilson and Hilferty's approximation, and the sighting that the others contradict most.
void ObjectAdjustment::test(const Eigen::MatrixXd& weight, LocatedObject& object) const {
  object.chi2 = residual_.dot(product(weight, residual_).col(0));
  object.degrees_of_freedom = static_cast<int>(rows()) - 3;
  if (object.degrees_of_freedom == 0) return;
  const double dof = object.degrees_of_freedom, spread = 2 / (9 * dof);
  object.agrees = std::cbrt(object.chi2 / dof) <= 1 - spread + table::kAgreement * std::sqrt(spread);
  if (object.agrees) return;
  // Of the residuals weighted: their covariance is W - W J (Jᵀ W J)⁻¹ Jᵀ W.
  const Eigen::MatrixXd wj = product(weight, by_point_);
  const Eigen::Matrix3d inverse = Eigen::Matrix3d(product(by_point_.transpose(), wj)).inverse();
  const Eigen::MatrixXd weighted = product(weight, residual_);
  double most = -1;
  for (std::size_t i = 0; i < sightings_.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(2 * i);
    const Eigen::Matrix<double, 2, 3> part = wj.middleRows<2>(row);
    const Eigen::Matrix2d spread_of = weight.block<2, 2>(row, row) - part * inverse * part.transpose();
    const Eigen::Vector2d off = weighted.block<2, 1>(row, 0);
    const double contradiction = off.dot(spread_of.inverse() * off);
    if (contradiction > most) {
      most = contradiction;
      object.worst = i;
    }
  }
}

std::variant<LocatedObject, LocationProblem> ObjectAdjustment::locate(const std::optional<Eigen::MatrixXd>& joint) {
  const auto begin = start();
  if (const auto* problem = std::get_if<LocationProblem>(&begin)) return *problem;
  Vector3 at = std::get<Vector3>(begin);
  if (!linearize(at)) return LocationProblem::diverging;
  Eigen::MatrixXd weight;
  Eigen::Matrix3d inverse;
  for (int i = 0; i < table::kObjectIterations; ++i) {
    weight = variance(joint, false).llt().solve(Eigen::MatrixXd::Identity(rows(), rows()));
    const Eigen::MatrixXd jtw = product(by_point_.transpose(), weight);
    inverse = Eigen::Matrix3d(product(jtw, by_point_)).inverse();
    if (!inverse.allFinite()) return LocationProblem::diverging;
    const Vector3 step = -inverse * Vector3(product(jtw, residual_));
    at += step;
    if (!at.allFinite() || !linearize(at)) return LocationProblem::diverging;
    if (step.norm() < table::kObjectConverged_m) break;
  }
  LocatedObject object;
  object.place = {at.x(), at.y()};
  object.height_m = at.z();
  test(weight, object);
  // Of the estimate -inverse Jᵀ W r under the errors as they may be.
  const Eigen::MatrixXd gain = product(product(inverse, by_point_.transpose()), weight);
  const auto propagated = [&](const Eigen::MatrixXd& v) -> Eigen::Matrix3d {
    return product(product(gain, v), gain.transpose());
  };
  object.covariance_m2 = propagated(variance(joint, false));
  if (!joint) {
    // What common errors would add, in the directions where they add something.
    const Eigen::Matrix3d more = propagated(variance(joint, true)) - object.covariance_m2;
    object.covariance_m2 +=
        with_eigenvalues(0.5 * (more + more.transpose()), [](double value) { return std::max(value, 0.0); });
  }
  if (!object.agrees) object.covariance_m2 *= std::max(1.0, object.chi2 / object.degrees_of_freedom);
  object.covariance_m2 = (0.5 * (object.covariance_m2 + object.covariance_m2.transpose())).eval();
  object.ellipse_95 = error_ellipse_95(object.covariance_m2.topLeftCorner<2, 2>());
  for (std::size_t i = 0; i < sightings_.size(); ++i) {
    object.residual_px.emplace_back(residual_.segment<2>(static_cast<Eigen::Index>(2 * i)));
  }
  return object;
}

[[noreturn]] void reject_sighting(const char* what, std::size_t index, const char* expected, const std::string& found) {
  throw UsageError({.what = what,
                    .where = fmt::format("sighting {}", index),
                    .expected = expected,
                    .found = found,
                    .fix = "correct the input"});
}

}  // namespace

std::string_view name_of(LocationProblem problem) {
  switch (problem) {
    case LocationProblem::above_horizon: return "above_horizon";
    case LocationProblem::no_ground: return "no_ground";
    case LocationProblem::diverging: return "diverging";
  }
  return "";
}

ErrorEllipse error_ellipse_95(const Eigen::Matrix2d& covariance_m2) {
  const double scale = table::kChi2Of95;
  return error_ellipse(scale * covariance_m2(0, 0), scale * covariance_m2(0, 1), scale * covariance_m2(1, 1));
}

std::variant<LocatedObject, LocationProblem> place_object(const CameraModel& camera, const GroundSurface& ground,
                                                          std::span<const SightedFrame> frames,
                                                          std::span<const ObjectSighting> sightings,
                                                          double terrain_sigma_m,
                                                          const std::optional<Eigen::MatrixXd>& joint_covariance) {
  if (sightings.empty() || sightings.size() > table::kMaxSightings) {
    throw UsageError({.what = "an object needs sightings",
                      .where = "object",
                      .expected = fmt::format("1 to {}", table::kMaxSightings),
                      .found = fmt::format("{}", sightings.size()),
                      .fix = "give the best ones"});
  }
  for (std::size_t i = 0; i < sightings.size(); ++i) {
    const ObjectSighting& s = sightings[i];
    if (s.frame >= frames.size())
      reject_sighting("there is no such frame", i, "one of the list", std::to_string(s.frame));
    if (!s.pixel.allFinite()) reject_sighting("the pixel is not a number", i, "finite numbers", "NaN or infinity");
    if (!(s.sigma_px > 0) || !std::isfinite(s.sigma_px)) {
      reject_sighting("the sigma is impossible", i, "a finite number above 0", fmt::format("{}", s.sigma_px));
    }
    const SightedFrame& frame = frames[s.frame];
    const Attitude& attitude = frame.pose.attitude;
    if (!frame.covariance.allFinite() || !frame.pose.position.vector().allFinite() ||
        !std::isfinite(frame.pose.agl_m + attitude.heading_rad + attitude.pitch_rad + attitude.roll_rad)) {
      reject_sighting("the frame's pose is not a number", i, "finite numbers", "NaN or infinity");
    }
  }
  const auto size = static_cast<Eigen::Index>(6 * frames.size());
  const bool fits = !joint_covariance || (joint_covariance->rows() == size && joint_covariance->cols() == size &&
                                          joint_covariance->allFinite());
  if (!(terrain_sigma_m > 0) || !std::isfinite(terrain_sigma_m) || !fits) {
    throw UsageError({.what = "the uncertainty is impossible",
                      .where = "object",
                      .expected = "a terrain sigma above 0, and a covariance with six rows for each frame",
                      .found = fmt::format("{} m", terrain_sigma_m),
                      .fix = "correct the input"});
  }
  return ObjectAdjustment(camera, ground, frames, sightings, terrain_sigma_m).locate(joint_covariance);
}

}  // namespace nadir
