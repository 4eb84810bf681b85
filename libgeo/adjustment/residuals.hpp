// The residuals of a block adjustment as Ceres' cost functions: what each measurement says of frames, points and the
// calibration that all frames share. Each is divided by its sigma: dimensionless, of variance 1.
//
// State of a frame: its centre C (east, north, up [m], in the local plane) and a rotation vector w [rad], in the camera
// frame, from a reference attitude that is near: R = R_ref Exp(w) is world_from_camera. A point X is in the camera
//   p = camera_from_world(X) = Rᵀ (X - C).
// A small turn d of the camera (R Exp(d)) moves it by p × d; a change of w turns the camera by d = J_r(w) dw with the
// right Jacobian of SO(3): J_r = I - (1 - cos t)/t² [w]× + (t - sin t)/t³ [w]×²,  t = |w|.
//
// Calibration: log focal f, distortion k1 k2 p1 p2 k3 (camera.hpp's model), boresight b [rad], log height scale s.
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>

#include "adjustment/pose_covariance.hpp"
#include "vision/camera.hpp"
#include "vision/ground_surface.hpp"

namespace ceres {
class CostFunction;
class LossFunction;
}  // namespace ceres

namespace nadir {

// A frame's parameters, and the attitude that they start from.
struct FrameBlock {
  std::array<double, 6> values{};  // C, w
  Eigen::Matrix3d reference = Eigen::Matrix3d::Identity();

  Eigen::Vector3d centre_m() const { return Eigen::Map<const Eigen::Vector3d>(values.data()); }
  Eigen::Matrix3d world_from_camera() const;
  CameraPose pose(const GroundSurface& ground) const;
  void recentre();  // w becomes zero, the attitude stays
};

struct CalibrationBlock {
  double log_focal = 0;
  std::array<double, 5> distortion{};
  std::array<double, 3> boresight_rad{};
  double log_height_scale = 0;
};

// The lens of a camera whose focal length and distortion are adjusted. Beyond the image the polynomial continues
// straight, as CameraModel's does beyond its fold.
class AdjustableLens {
 public:
  explicit AdjustableLens(const CameraModel& camera);

  // Where a point of the camera frame appears; its derivatives with respect to the point, the log focal length and the
  // distortion, each of which may be null.
  Eigen::Vector2d project(const Eigen::Vector3d& point, double log_focal, const double* distortion,
                          Eigen::Matrix<double, 2, 3>* by_point, Eigen::Vector2d* by_focal,
                          Eigen::Matrix<double, 2, 5>* by_distortion) const;

 private:
  CameraModel camera_;
  double reach_ = 0;  // distance from the axis at z = 1 up to which the polynomial is used
};

// A frame's state less a measured pose, in pose_cost()'s order and before whitening. Nothing below ground.
std::optional<Eigen::Matrix<double, 6, 1>> pose_difference(const GroundSurface& ground, const FrameBlock& frame,
                                                           const CameraPose& measured);

// Where the point appears, or nothing when it is not in front of the camera.
std::optional<Eigen::Vector2d> project(const AdjustableLens& lens, const CalibrationBlock& calibration,
                                       const FrameBlock& frame, const Eigen::Vector3d& point_m);

// All references must outlive the cost function. Blocks in brackets, in their order.

// (seen - observed pixel) / sigma [frame 6, log focal 1, distortion 5, point 3]. Fails behind the camera.
ceres::CostFunction* reprojection_cost(const AdjustableLens& lens, const FrameBlock& frame,
                                       const Eigen::Vector2d& pixel, double sigma_px);
// Log(R (R_measured Exp(b))ᵀ) in the world's axes, over (tilt, tilt, heading) sigma [frame 6, boresight 3].
ceres::CostFunction* attitude_cost(const FrameBlock& frame, const Eigen::Matrix3d& measured_world_from_camera,
                                   double tilt_sigma_rad, double heading_sigma_rad);
// (log(C_up - ground(C)) + s - log measured) / sigma [frame 6, log height scale 1].
ceres::CostFunction* height_cost(const GroundSurface& ground, double measured_agl_m, double log_sigma);
// L⁻¹ ((C_east, C_north) - position), covariance L Lᵀ [frame 6].
ceres::CostFunction* position_cost(PlanePoint position, const Eigen::Matrix2d& covariance_m2);
// L⁻¹ (C_east - east, C_north - north, log(C_up - ground(C)) - log agl, heading, pitch and roll less the measured
// ones), covariance L Lᵀ of these six [frame 6]. Fails below ground.
ceres::CostFunction* pose_cost(const GroundSurface& ground, const FrameBlock& frame, const CameraPose& measured,
                               const Eigen::Matrix<double, 6, 6>& covariance);
// (C_b - C_a - step) / sigma [frame a 6, frame b 6].
ceres::CostFunction* motion_cost(const Eigen::Vector3d& step_m, double sigma_m);
// (X_up - ground(X_east, X_north)) / sigma [point 3].
ceres::CostFunction* terrain_cost(const GroundSurface& ground, double sigma_m);
// ((X_east, X_north) - position) / sigma [point 3].
ceres::CostFunction* control_cost(PlanePoint position, double sigma_m);

// Dynamic covariance scaling, for anchors; block_adjustment.hpp explains it. χ² up to `bound` counts fully. The bound
// is read at each evaluation: it shrinks from round to round.
ceres::LossFunction* switchable_loss(const double& bound);
// Huber's, from `width` sigmas on, likewise.
ceres::LossFunction* huber_loss(const double& width);
// The switch s of dynamic covariance scaling.
double switch_value(double chi2, double bound);

}  // namespace nadir
