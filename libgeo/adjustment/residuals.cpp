#include "adjustment/residuals.hpp"

#include <ceres/autodiff_cost_function.h>
#include <ceres/loss_function.h>
#include <ceres/rotation.h>
#include <ceres/sized_cost_function.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "adjustment/adjustment_parameters.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

namespace table = parameters::adjustment;

template <int Rows, int Columns>
using Jacobian = Eigen::Map<Eigen::Matrix<double, Rows, Columns, Columns == 1 ? Eigen::ColMajor : Eigen::RowMajor>>;

// d of R Exp(d) per change of w.
Eigen::Matrix3d right_jacobian(const Eigen::Vector3d& w) {
  const double t2 = w.squaredNorm();
  const Eigen::Matrix3d cross = skew(w);
  if (t2 < table::kSmallTurn_rad * table::kSmallTurn_rad)
    return Eigen::Matrix3d::Identity() - 0.5 * cross + cross * cross / 6.0;
  const double t = std::sqrt(t2);
  return Eigen::Matrix3d::Identity() - (1 - std::cos(t)) / t2 * cross + (t - std::sin(t)) / (t2 * t) * cross * cross;
}

Eigen::Vector2d slope_at(const GroundSurface& ground, double east_m, double north_m) {
  constexpr double d = table::kSlopeBaseline_m;
  return {(ground.height_m({east_m + d, north_m}) - ground.height_m({east_m - d, north_m})) / (2 * d),
          (ground.height_m({east_m, north_m + d}) - ground.height_m({east_m, north_m - d})) / (2 * d)};
}

class ReprojectionCost final : public ceres::SizedCostFunction<2, 6, 1, 5, 3> {
 public:
  ReprojectionCost(const AdjustableLens& lens, const FrameBlock& frame, const Eigen::Vector2d& pixel, double sigma_px)
      : lens_(lens), frame_(frame), pixel_(pixel), weight_(1 / sigma_px) {}

  bool Evaluate(double const* const* blocks, double* residual, double** jacobians) const override {
    const Eigen::Map<const Eigen::Vector3d> centre(blocks[0]), w(blocks[0] + 3), point(blocks[3]);
    const Eigen::Matrix3d camera_from_world = (frame_.reference * rotation_from_vector(w)).transpose();
    const Eigen::Vector3d p = camera_from_world * (point - centre);
    if (!(p.z() > table::kMinDepth_m)) return false;
    Eigen::Matrix<double, 2, 3> by_point;
    Eigen::Vector2d by_focal;
    Eigen::Matrix<double, 2, 5> by_distortion;
    const bool wanted = jacobians != nullptr;
    Eigen::Map<Eigen::Vector2d> r(residual);
    r = weight_ * (lens_.project(p, *blocks[1], blocks[2], wanted ? &by_point : nullptr, wanted ? &by_focal : nullptr,
                                 wanted ? &by_distortion : nullptr) -
                   pixel_);
    if (!wanted) return true;
    const Eigen::Matrix<double, 2, 3> by_world = weight_ * by_point * camera_from_world;
    if (jacobians[0] != nullptr) {
      Jacobian<2, 6> frame(jacobians[0]);
      frame.leftCols<3>() = -by_world;
      frame.rightCols<3>() = weight_ * by_point * skew(p) * right_jacobian(w);
    }
    if (jacobians[1] != nullptr) Jacobian<2, 1>{jacobians[1]} = weight_ * by_focal;
    if (jacobians[2] != nullptr) Jacobian<2, 5>{jacobians[2]} = weight_ * by_distortion;
    if (jacobians[3] != nullptr) Jacobian<2, 3>{jacobians[3]} = by_world;
    return true;
  }

 private:
  const AdjustableLens& lens_;
  const FrameBlock& frame_;
  Eigen::Vector2d pixel_;
  double weight_;
};

struct AttitudeResidual {
  const FrameBlock& frame;
  std::array<double, 4> measured;  // quaternion
  double tilt_sigma_rad, heading_sigma_rad;

  template <typename T>
  bool operator()(const T* state, const T* boresight, T* residual) const {
    T reference[4], turn[4], attitude[4], measured_t[4], bore[4], expected[4], difference[4], vector[3];
    const Eigen::Quaterniond q(frame.reference);
    const double values[] = {q.w(), q.x(), q.y(), q.z()};
    for (int i = 0; i < 4; ++i) {
      reference[i] = T(values[i]);
      measured_t[i] = T(measured[static_cast<std::size_t>(i)]);
    }
    ceres::AngleAxisToQuaternion(state + 3, turn);
    ceres::QuaternionProduct(reference, turn, attitude);
    ceres::AngleAxisToQuaternion(boresight, bore);
    ceres::QuaternionProduct(measured_t, bore, expected);
    const T inverse[4] = {expected[0], -expected[1], -expected[2], -expected[3]};
    ceres::QuaternionProduct(attitude, inverse, difference);
    ceres::QuaternionToAngleAxis(difference, vector);
    residual[0] = vector[0] / T(tilt_sigma_rad);
    residual[1] = vector[1] / T(tilt_sigma_rad);
    residual[2] = vector[2] / T(heading_sigma_rad);
    return true;
  }
};

class HeightCost final : public ceres::SizedCostFunction<1, 6, 1> {
 public:
  HeightCost(const GroundSurface& ground, double measured_agl_m, double log_sigma)
      : ground_(ground), log_measured_(std::log(measured_agl_m)), weight_(1 / log_sigma) {}

  bool Evaluate(double const* const* blocks, double* residual, double** jacobians) const override {
    const double* c = blocks[0];
    const double agl_m = c[2] - ground_.height_m({c[0], c[1]});
    if (!(agl_m > 0)) return false;
    residual[0] = weight_ * (std::log(agl_m) + *blocks[1] - log_measured_);
    if (jacobians == nullptr) return true;
    if (jacobians[0] != nullptr) {
      const Eigen::Vector2d slope = slope_at(ground_, c[0], c[1]);
      Jacobian<1, 6>{jacobians[0]} << -slope.x(), -slope.y(), 1, 0, 0, 0;
      Jacobian<1, 6>{jacobians[0]} *= weight_ / agl_m;
    }
    if (jacobians[1] != nullptr) *jacobians[1] = weight_;
    return true;
  }

 private:
  const GroundSurface& ground_;
  double log_measured_, weight_;
};

class PositionCost final : public ceres::SizedCostFunction<2, 6> {
 public:
  PositionCost(PlanePoint position, const Eigen::Matrix2d& covariance_m2) : position_(position.vector()) {
    const Eigen::Matrix2d lower = covariance_m2.llt().matrixL();
    whiten_ = lower.triangularView<Eigen::Lower>().solve(Eigen::Matrix2d::Identity());
  }

  bool Evaluate(double const* const* blocks, double* residual, double** jacobians) const override {
    Eigen::Map<Eigen::Vector2d>(residual, 2) = whiten_ * (Eigen::Map<const Eigen::Vector2d>(blocks[0]) - position_);
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      Jacobian<2, 6> by_frame(jacobians[0]);
      by_frame.setZero();
      by_frame.leftCols<2>() = whiten_;
    }
    return true;
  }

 private:
  Eigen::Vector2d position_;
  Eigen::Matrix2d whiten_;
};

// Of (east, north, log height, heading, pitch, roll); C in `centre`.
std::optional<Eigen::Matrix<double, 6, 1>> pose_off(const GroundSurface& ground, const Eigen::Vector3d& centre,
                                                    const Attitude& attitude, const CameraPose& measured) {
  const double agl_m = centre.z() - ground.height_m({centre.x(), centre.y()});
  if (!(agl_m > 0)) return std::nullopt;
  Eigen::Matrix<double, 6, 1> off;
  off << centre.head<2>() - measured.position.vector(), std::log(agl_m / measured.agl_m),
      wrap_pi(attitude.heading_rad - measured.attitude.heading_rad), attitude.pitch_rad - measured.attitude.pitch_rad,
      wrap_pi(attitude.roll_rad - measured.attitude.roll_rad);
  return off;
}

class PoseCost final : public ceres::SizedCostFunction<6, 6> {
 public:
  PoseCost(const GroundSurface& ground, const FrameBlock& frame, const CameraPose& measured,
           const Eigen::Matrix<double, 6, 6>& covariance)
      : ground_(ground), frame_(frame), measured_(measured) {
    const Eigen::Matrix<double, 6, 6> lower = covariance.llt().matrixL();
    whiten_ = lower.triangularView<Eigen::Lower>().solve(Eigen::Matrix<double, 6, 6>::Identity());
  }

  bool Evaluate(double const* const* blocks, double* residual, double** jacobians) const override {
    const Eigen::Map<const Eigen::Vector3d> c(blocks[0]), w(blocks[0] + 3);
    const Attitude attitude = attitude_from_matrix(frame_.reference * rotation_from_vector(w));
    const auto off = pose_off(ground_, c, attitude, measured_);
    if (!off) return false;
    Eigen::Map<Eigen::Matrix<double, 6, 1>>(residual, 6) = whiten_ * *off;
    if (jacobians == nullptr || jacobians[0] == nullptr) return true;
    const double agl_m = c.z() - ground_.height_m({c.x(), c.y()});
    const Eigen::Vector2d slope = slope_at(ground_, c.x(), c.y());
    Eigen::Matrix<double, 6, 6> by = Eigen::Matrix<double, 6, 6>::Zero();
    by(0, 0) = by(1, 1) = 1;
    by.block<1, 3>(2, 0) << -slope.x() / agl_m, -slope.y() / agl_m, 1 / agl_m;
    by.bottomRightCorner<3, 3>() = turn_by_angles(attitude).inverse() * right_jacobian(w);
    Jacobian<6, 6>{jacobians[0]} = whiten_ * by;
    return true;
  }

 private:
  const GroundSurface& ground_;
  const FrameBlock& frame_;
  CameraPose measured_;
  Eigen::Matrix<double, 6, 6> whiten_;
};

class MotionCost final : public ceres::SizedCostFunction<3, 6, 6> {
 public:
  MotionCost(const Eigen::Vector3d& step_m, double sigma_m) : step_m_(step_m), weight_(1 / sigma_m) {}

  bool Evaluate(double const* const* blocks, double* residual, double** jacobians) const override {
    const Eigen::Map<const Eigen::Vector3d> from(blocks[0]), to(blocks[1]);
    Eigen::Map<Eigen::Vector3d>(residual, 3) = weight_ * (to - from - step_m_);
    if (jacobians == nullptr) return true;
    for (int end = 0; end < 2; ++end) {
      if (jacobians[end] == nullptr) continue;
      Jacobian<3, 6> by_frame(jacobians[end]);
      by_frame.setZero();
      by_frame.leftCols<3>() = (end == 0 ? -weight_ : weight_) * Eigen::Matrix3d::Identity();
    }
    return true;
  }

 private:
  Eigen::Vector3d step_m_;
  double weight_;
};

class TerrainCost final : public ceres::SizedCostFunction<1, 3> {
 public:
  TerrainCost(const GroundSurface& ground, double sigma_m) : ground_(ground), weight_(1 / sigma_m) {}

  bool Evaluate(double const* const* blocks, double* residual, double** jacobians) const override {
    const double* x = blocks[0];
    residual[0] = weight_ * (x[2] - ground_.height_m({x[0], x[1]}));
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      const Eigen::Vector2d slope = slope_at(ground_, x[0], x[1]);
      Jacobian<1, 3>{jacobians[0]} << -weight_ * slope.x(), -weight_ * slope.y(), weight_;
    }
    return true;
  }

 private:
  const GroundSurface& ground_;
  double weight_;
};

class ControlCost final : public ceres::SizedCostFunction<2, 3> {
 public:
  ControlCost(PlanePoint position, double sigma_m) : position_(position.vector()), weight_(1 / sigma_m) {}

  bool Evaluate(double const* const* blocks, double* residual, double** jacobians) const override {
    Eigen::Map<Eigen::Vector2d>(residual, 2) = weight_ * (Eigen::Map<const Eigen::Vector2d>(blocks[0]) - position_);
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      Jacobian<2, 3>{jacobians[0]} << weight_, 0, 0, 0, weight_, 0;
    }
    return true;
  }

 private:
  Eigen::Vector2d position_;
  double weight_;
};

class SwitchableLoss final : public ceres::LossFunction {
 public:
  explicit SwitchableLoss(const double& bound) : bound_(bound) {}
  void Evaluate(double chi2, double rho[3]) const override {
    if (chi2 <= bound_) {
      rho[0] = chi2, rho[1] = 1, rho[2] = 0;
      return;
    }
    const double sum = bound_ + chi2, s = 2 * bound_ / sum;
    rho[0] = 3 * bound_ - 2 * bound_ * s;
    rho[1] = s * s;
    rho[2] = -2 * s * s / sum;
  }

 private:
  const double& bound_;
};

class HuberLoss final : public ceres::LossFunction {
 public:
  explicit HuberLoss(const double& width) : width_(width) {}
  void Evaluate(double chi2, double rho[3]) const override {
    if (chi2 <= width_ * width_) {
      rho[0] = chi2, rho[1] = 1, rho[2] = 0;
      return;
    }
    const double r = std::sqrt(chi2);
    rho[0] = 2 * width_ * r - width_ * width_;
    rho[1] = width_ / r;
    rho[2] = -0.5 * rho[1] / chi2;
  }

 private:
  const double& width_;
};

}  // namespace

Eigen::Matrix3d FrameBlock::world_from_camera() const {
  return reference * rotation_from_vector(Eigen::Map<const Eigen::Vector3d>(values.data() + 3));
}

CameraPose FrameBlock::pose(const GroundSurface& ground) const {
  CameraPose pose;
  pose.position = {values[0], values[1]};
  pose.agl_m = values[2] - ground.height_m(pose.position);
  pose.attitude = attitude_from_matrix(world_from_camera());
  return pose;
}

void FrameBlock::recentre() {
  reference = Eigen::Quaterniond(world_from_camera()).normalized().toRotationMatrix();
  values[3] = values[4] = values[5] = 0;
}

AdjustableLens::AdjustableLens(const CameraModel& camera) : camera_(camera) {
  for (const double x : {0.0, camera.width - 1.0}) {
    for (const double y : {0.0, camera.height - 1.0}) {
      reach_ = std::max(reach_, camera.ray_from_pixel({x, y}).head<2>().norm());
    }
  }
  reach_ *= table::kLensMargin;
}

Eigen::Vector2d AdjustableLens::project(const Eigen::Vector3d& point, double log_focal, const double* k,
                                        Eigen::Matrix<double, 2, 3>* by_point, Eigen::Vector2d* by_focal,
                                        Eigen::Matrix<double, 2, 5>* by_distortion) const {
  const Eigen::Vector2d image = point.head<2>() / point.z();
  const double off_axis = image.norm();
  const double share = off_axis > reach_ ? reach_ / off_axis : 1;
  const double x = share * image.x(), y = share * image.y(), r2 = x * x + y * y;
  const double growth = r2 * (k[0] + r2 * (k[1] + r2 * k[4]));
  const Eigen::Vector2d shift(x * growth + 2 * k[2] * x * y + k[3] * (r2 + 2 * x * x),
                              y * growth + k[2] * (r2 + 2 * y * y) + 2 * k[3] * x * y);
  const Eigen::Vector2d focal = std::exp(log_focal) * Eigen::Vector2d(camera_.fx, camera_.fy);
  const Eigen::Vector2d from_centre = focal.cwiseProduct(image + shift);
  if (by_point != nullptr) {
    Eigen::Matrix2d by_image = Eigen::Matrix2d::Identity();
    if (share == 1) {
      const double steep = 2 * (k[0] + r2 * (2 * k[1] + r2 * 3 * k[4]));  // of `growth` with r2, doubled
      const double mixed = x * y * steep + 2 * k[2] * x + 2 * k[3] * y;
      by_image(0, 0) += growth + x * x * steep + 2 * k[2] * y + 6 * k[3] * x;
      by_image(1, 1) += growth + y * y * steep + 6 * k[2] * y + 2 * k[3] * x;
      by_image(0, 1) += mixed;
      by_image(1, 0) += mixed;
    }
    Eigen::Matrix<double, 2, 3> image_by_point;
    image_by_point << 1, 0, -image.x(), 0, 1, -image.y();
    *by_point = focal.asDiagonal() * by_image * image_by_point / point.z();
  }
  if (by_focal != nullptr) *by_focal = from_centre;
  if (by_distortion != nullptr) {
    Eigen::Matrix<double, 2, 5> by;
    by << x * r2, x * r2 * r2, 2 * x * y, r2 + 2 * x * x, x * r2 * r2 * r2,  //
        y * r2, y * r2 * r2, r2 + 2 * y * y, 2 * x * y, y * r2 * r2 * r2;
    *by_distortion = focal.asDiagonal() * by;
  }
  return from_centre + Eigen::Vector2d(camera_.cx, camera_.cy);
}

std::optional<Eigen::Vector2d> project(const AdjustableLens& lens, const CalibrationBlock& calibration,
                                       const FrameBlock& frame, const Eigen::Vector3d& point_m) {
  const Eigen::Vector3d p = frame.world_from_camera().transpose() * (point_m - frame.centre_m());
  if (!(p.z() > table::kMinDepth_m)) return std::nullopt;
  return lens.project(p, calibration.log_focal, calibration.distortion.data(), nullptr, nullptr, nullptr);
}

std::optional<Eigen::Matrix<double, 6, 1>> pose_difference(const GroundSurface& ground, const FrameBlock& frame,
                                                           const CameraPose& measured) {
  return pose_off(ground, frame.centre_m(), attitude_from_matrix(frame.world_from_camera()), measured);
}

ceres::CostFunction* reprojection_cost(const AdjustableLens& lens, const FrameBlock& frame,
                                       const Eigen::Vector2d& pixel, double sigma_px) {
  return new ReprojectionCost(lens, frame, pixel, sigma_px);
}

ceres::CostFunction* attitude_cost(const FrameBlock& frame, const Eigen::Matrix3d& measured_world_from_camera,
                                   double tilt_sigma_rad, double heading_sigma_rad) {
  const Eigen::Quaterniond q(measured_world_from_camera);
  return new ceres::AutoDiffCostFunction<AttitudeResidual, 3, 6, 3>(
      new AttitudeResidual{frame, {q.w(), q.x(), q.y(), q.z()}, tilt_sigma_rad, heading_sigma_rad});
}

ceres::CostFunction* height_cost(const GroundSurface& ground, double measured_agl_m, double log_sigma) {
  return new HeightCost(ground, measured_agl_m, log_sigma);
}

ceres::CostFunction* position_cost(PlanePoint position, const Eigen::Matrix2d& covariance_m2) {
  return new PositionCost(position, covariance_m2);
}

ceres::CostFunction* pose_cost(const GroundSurface& ground, const FrameBlock& frame, const CameraPose& measured,
                               const Eigen::Matrix<double, 6, 6>& covariance) {
  return new PoseCost(ground, frame, measured, covariance);
}

ceres::CostFunction* motion_cost(const Eigen::Vector3d& step_m, double sigma_m) {
  return new MotionCost(step_m, sigma_m);
}

ceres::CostFunction* terrain_cost(const GroundSurface& ground, double sigma_m) {
  return new TerrainCost(ground, sigma_m);
}

ceres::CostFunction* control_cost(PlanePoint position, double sigma_m) { return new ControlCost(position, sigma_m); }

ceres::LossFunction* switchable_loss(const double& bound) { return new SwitchableLoss(bound); }
ceres::LossFunction* huber_loss(const double& width) { return new HuberLoss(width); }

double switch_value(double chi2, double bound) { return chi2 <= bound ? 1 : 2 * bound / (bound + chi2); }

}  // namespace nadir
