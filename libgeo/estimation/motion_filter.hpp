// Position and velocity in the map's plane.
//
// Between anchors the position is carried by odometry steps or, without them, by its velocity. Odometry errs in scale
// and direction by the same share in every step, so that this error grows with the distance from the last anchor and
// not with its root: it is kept apart (the `carried` vector) and added to the covariance that is told.
#pragma once

#include <Eigen/Core>
#include <optional>

namespace nadir {

struct MotionOptions {
  double start_velocity_sigma_mps = 15;  // of each axis, when nothing is known
  double acceleration_mps2 = 1.5;        // of unmodelled changes of velocity: a fixed wing that turns
};

class MotionFilter {
 public:
  MotionFilter(const Eigen::Vector2d& position_m, double sigma_m, const MotionOptions& options = {});

  // By velocity alone. The covariance never shrinks.
  void advance(double seconds);

  // By an odometry step (east, north) with its own random error, and the errors that all steps share.
  struct Step {
    Eigen::Vector2d moved_m = Eigen::Vector2d::Zero();
    Eigen::Matrix2d covariance_m2 = Eigen::Matrix2d::Zero();
    double heading_sigma_rad = 0;
    double scale_sigma = 0;
  };
  void advance(double seconds, const Step& step);

  void anchor(const Eigen::Vector2d& position_m, const Eigen::Matrix2d& covariance_m2);
  // Forgets the position and begins anew (after a loss), keeping the velocity.
  void restart(const Eigen::Vector2d& position_m, const Eigen::Matrix2d& covariance_m2);

  // Squared Mahalanobis distance of a position to the prediction, 2 degrees of freedom.
  double chi2(const Eigen::Vector2d& position_m, const Eigen::Matrix2d& covariance_m2) const;

  Eigen::Vector2d position_m() const { return state_.head<2>(); }
  Eigen::Vector2d velocity_mps() const { return state_.tail<2>(); }
  Eigen::Matrix2d covariance_m2() const;  // of the position, shared odometry errors included
  double sigma_m() const;                 // one axis of the equivalent circle

 private:
  MotionOptions options_;
  Eigen::Vector4d state_ = Eigen::Vector4d::Zero();  // east, north, velocity east, north
  Eigen::Matrix4d covariance_ = Eigen::Matrix4d::Zero();
  Eigen::Vector2d carried_m_ = Eigen::Vector2d::Zero();  // by odometry since the last anchor
  double heading_sigma_rad_ = 0;
  double scale_sigma_ = 0;
};

}  // namespace nadir
