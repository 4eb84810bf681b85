// The relative track of a segment: where each of its frames was taken, seen from its first one.
//
// Odometry measures the way from frame to frame in metres (the height above ground is known) and in the directions of a
// heading (measured, or propagated). So the shape of a segment is known but for what all of its frames share:
//
//   x_k = t + s R(ψ) p_k + w_k        heading_k = ψ + (that of the online estimate)
//
//   p_k     offset of frame k from the first one, by odometry, under the headings and heights of the online estimates
//   t       position of the first frame                   unknown: this is what it means to float
//   ψ, s    what all headings and all heights share       small where telemetry measures them; ψ is any where
//                                                         no heading was ever measured
//   w_k     the errors of the steps, added up: a random walk whose covariance is that of the steps
//
// t, ψ and s are a similarity of the plane: the part of Sim(3) that a nadir camera with known tilt and terrain leaves.
// Roll, pitch and the height's zero belong to the telemetry, and each look at the map corrects them for itself.
//
// All of it follows from what is stored of the frames (answers of vision, online estimates, telemetry), without
// pictures.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "estimation/estimate.hpp"
#include "estimation/telemetry.hpp"
#include "flights/recorded_vision.hpp"
#include "geodesy/plane_point.hpp"
#include "vision/camera.hpp"

namespace nadir {

// What is stored of a frame.
struct ObservedFrame {
  std::size_t frame = 0;
  Telemetry telemetry;
  Estimate estimate;  // online
  StateEstimate state;
  AnchorReport look;  // at the map, in flight
  VisionAnswers answers;
};

struct ShapeFrame {
  std::size_t frame = 0;
  double time_s = 0;
  Eigen::Vector2d offset_m = Eigen::Vector2d::Zero();            // p_k: east, north
  Eigen::Matrix2d step_covariance_m2 = Eigen::Matrix2d::Zero();  // of the way from the frame before it
  Attitude attitude;                                             // heading by the estimate, tilt by the telemetry
  double agl_m = 0;
  bool tilt_measured = false;
  bool usable = false;  // neither black nor blurred nor repeated
  double evidence = 0;  // ln of the likelihood ratio of its look in flight; 0: there was none
};

struct SegmentShape {
  int segment = 0;
  std::vector<ShapeFrame> frames;  // the first one has the offset 0
  double turn_sigma_rad = 0;       // of ψ, by the telemetry
  double log_scale_sigma = 0;      // of ln s
};

// observed: all frames of one segment, in order. A frame that no step links to the one before ends the shape.
// uncertainty: of the camera file.
SegmentShape segment_shape(std::span<const ObservedFrame> observed, const TelemetryUncertainty& uncertainty);

// A look at the map in one of the frames.
struct ShapeLook {
  std::size_t index = 0;  // in the shape
  PlanePoint position;
  Eigen::Matrix2d covariance_m2 = Eigen::Matrix2d::Zero();
  double heading_rad = 0;
  double heading_sigma_rad = 0;
};

// The similarity of a shape by looks at the map: Gaussian regression. With the prior covariance Σ of θ = (t, ψ, ln s)
// about a reference frame, the Jacobians J_k of x_k, and the covariance K_jk of the random walks w_j and w_k (that of
// the steps which both have in common, counted from the reference frame), all frames have the joint covariance J_j Σ
// J_kᵀ + K_jk; a look adds its own R. Conditioning on the looks gives every frame's position and covariance, and the
// window in which the next look belongs. Looks are few, so nothing is approximated but the rotation, which is
// linearized again at the solution.
class SegmentSimilarity {
 public:
  struct Prior {
    std::size_t reference = 0;  // index of a frame
    PlanePoint position;        // of this frame
    double position_sigma_m = 0;
    double turn_rad = 0;  // ψ
    double turn_sigma_rad = 0;
    double log_scale_sigma = 0;
  };
  struct Pose {
    PlanePoint position;
    Eigen::Matrix2d covariance_m2 = Eigen::Matrix2d::Zero();
    double heading_rad = 0, heading_sigma_rad = 0;
    double agl_m = 0, log_agl_sigma = 0;
  };

  // shape: must outlive this.
  SegmentSimilarity(const SegmentShape& shape, const Prior& prior);

  void add(const ShapeLook& look);
  // Scales the covariances of the looks by what their scatter about the shape says: the a posteriori variance factor
  // φ of a least-squares adjustment, R -> E[φ] R, with
  //   ln p(φ) = -½ ln det Σ(φ) - ½ rᵀ Σ(φ)⁻¹ r - ½ ν (ln φ + 1/φ),   Σ(φ) = J Σ Jᵀ + K + φ R
  // and the residuals r of all looks about the prior. The last term is the stated covariance as an inverse χ² prior of
  // ν degrees of freedom. The mean and not the mode, because the covariance over all φ is the mean of covariances: two
  // looks that agree prove little. What all looks have in common does not scatter, and must not be in R.
  void scale_looks_by_scatter();
  Pose pose(std::size_t index) const;
  double turn_rad() const;
  double log_scale() const;
  const std::vector<ShapeLook>& looks() const { return looks_; }

 private:
  using Parameters = Eigen::Vector4d;  // east, north, ψ - that of the prior, ln s
  using Jacobian = Eigen::Matrix<double, 2, 4>;

  Eigen::Vector2d way_m(std::size_t index) const;  // from the reference frame, turned by the prior
  Eigen::Vector2d place(std::size_t index, const Parameters& at) const;
  Jacobian jacobian(std::size_t index, const Parameters& at) const;
  Eigen::Matrix2d common_walk_m2(std::size_t one, std::size_t other) const;
  Eigen::MatrixXd look_rows(const Parameters& at) const;     // three a look: east, north, heading
  Eigen::VectorXd residuals(const Parameters& at) const;     // likewise, about the prior
  Eigen::MatrixXd look_noise(double variance_factor) const;  // of the looks, the walks included
  void solve();

  const SegmentShape& shape_;
  Prior prior_;
  Eigen::Matrix2d turned_;                  // by the prior's ψ
  std::vector<Eigen::Matrix2d> walked_m2_;  // covariance of the way from the first frame
  std::vector<ShapeLook> looks_;
  Parameters solution_ = Parameters::Zero();
  Eigen::Vector4d prior_variance_;
  Eigen::MatrixXd inverse_;   // of the looks' joint covariance
  Eigen::VectorXd weighted_;  // inverse_ · residuals about the prior
};

}  // namespace nadir
