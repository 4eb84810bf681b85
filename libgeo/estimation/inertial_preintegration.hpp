// Preintegration of an inertial sensor's samples between two moments (Forster, Carlone, Dellaert, Scaramuzza:
// On-Manifold Preintegration for Real-Time Visual-Inertial Odometry, IEEE T-RO 33(1), 2017; equation numbers are
// theirs).
//
// Samples are those of three gyroscopes ω and three accelerometers f (specific force: at rest -g, that is 9.8 m/s² up)
// in one frame b of axes: image-up, image-right, optical axis. For a camera that looks straight down with image-up to
// the nose these are the aircraft's forward, right and down. With the biases b_g, b_a, which are removed, the samples
// between i and j sum up to what does not depend on the attitude, velocity and position at i (35 to 37):
//
//   ΔR = Π Exp((ω - b_g) dt)           R_j = R_i ΔR                              R: world from b
//   Δv = Σ ΔR (f - b_a) dt             v_j = v_i + g t + R_i Δv
//   Δp = Σ Δv dt + ½ ΔR (f - b_a) dt²  p_j = p_i + v_i t + ½ g t² + R_i Δp
//
// A sample is the mean over the time since the one before, as sensors with an anti-aliasing filter deliver it; within
// that time f is resolved with the attitude at its middle. Errors (δφ, δv, δp): ΔR Exp(δφ), Δv + δv, Δp + δp, with the
// covariance of the sensor's white noise (62, 63). Other biases b + δb change the result to first order (44):
//
//   ΔR Exp(J_Rg δb_g)      Δv + J_vg δb_g + J_va δb_a      Δp + J_pg δb_g + J_pa δb_a
//
// so that nothing is summed again when the biases become known better. Scale and misalignment of the sensor are not in
// this covariance: they are no white noise (flight_filter.hpp). Noise and limits: localizer_parameters.hpp, `inertial`.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

namespace nadir {

struct InertialSample {
  double time_s = 0;                                     // end of what it is the mean of; the clock of the frames
  Eigen::Vector3d rate_rad_s = Eigen::Vector3d::Zero();  // ω
  Eigen::Vector3d force_mps2 = Eigen::Vector3d::Zero();  // f
};

struct InertialBias {
  Eigen::Vector3d rate_rad_s = Eigen::Vector3d::Zero();
  Eigen::Vector3d force_mps2 = Eigen::Vector3d::Zero();
};

struct PreintegratedMotion {
  double seconds = 0;
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();                            // ΔR: b at i from b at j
  Eigen::Vector3d velocity_change_mps = Eigen::Vector3d::Zero();                 // Δv, in b at i
  Eigen::Vector3d displacement_m = Eigen::Vector3d::Zero();                      // Δp, in b at i
  Eigen::Matrix<double, 9, 9> covariance = Eigen::Matrix<double, 9, 9>::Zero();  // (δφ, δv, δp)
  InertialBias bias;                                                             // that was removed
  Eigen::Matrix3d turn_by_rate = Eigen::Matrix3d::Zero();                        // J_Rg
  Eigen::Matrix3d velocity_by_rate = Eigen::Matrix3d::Zero(), velocity_by_force = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d displacement_by_rate = Eigen::Matrix3d::Zero(), displacement_by_force = Eigen::Matrix3d::Zero();

  // The same with other biases, to first order.
  PreintegratedMotion with_bias(const InertialBias& other) const;
};

// Exp of a rotation vector, and its inverse, below half a turn.
Eigen::Matrix3d rotation_of(const Eigen::Vector3d& vector_rad);
Eigen::Vector3d rotation_vector_of(const Eigen::Matrix3d& rotation);
// v ↦ a × v
Eigen::Matrix3d cross_matrix(const Eigen::Vector3d& a);

// Of the samples in order of time, from one moment to a later one. Nothing where they leave a gap (kMaxGap_s) at an end
// or between.
std::optional<PreintegratedMotion> preintegrate(std::span<const InertialSample> samples, double from_s, double to_s,
                                                const InertialBias& bias = {});

// The same in parts of at most kMaxPart_s, in order: over longer ones the biases and the attitude at the beginning are
// no constants. Empty when a part has a gap, when to_s is not later, and when it is later than by kMaxWay_s.
std::vector<PreintegratedMotion> preintegrate_parts(std::span<const InertialSample> samples, double from_s,
                                                    double to_s);

// What can be used, in order of time and without duplicates: samples that are not finite, beyond the range of sensors
// (saturated), of the time up to after_s, or not later than the one before are left out.
std::vector<InertialSample> usable_samples(std::span<const InertialSample> samples, double after_s);

}  // namespace nadir
