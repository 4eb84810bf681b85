// What the χ² test of gps_health is compared with: a generalized likelihood ratio test for the onset of an offset or of
// a drift (Willsky and Jones 1976), once a second, which adds up what small differences have in common.
//
// d, the receiver's position less vision's, is on each axis, while both are honest,
//
//   d = s + v + n     s: Gauss-Markov, σ_s, 60 s: satellites, reflections, the map
//                     v: Gauss-Markov, σ_v, 20 s: vision, as sure as it claims of each frame
//                     n: white, a twentieth of σ_v²
//
// A Kalman filter of (s, v) predicts d; its innovations ν are white and of the variance S. What begins at θ adds
// u f(t - θ), with an unknown vector u: f = 1, an offset, or f = t - θ, a drift. The filter follows it in part: its
// response r to u = 1 obeys the filter's own recursion, and the innovations have the mean u g, g = f - (r_s + r_v).
// With the u that explains them best,
//
//   2 ln Λ(θ, f) = |Σ g ν / S|² / Σ (g² / S)
//
// The statistic is the largest of all onsets of the last 90 s, over the level of the innovations of the last minutes:
// vision claims σ that are about twice its errors, and so the test learns how good it is.
#pragma once

#include <Eigen/Core>
#include <deque>

namespace nadir::bench {

class OnsetRatio {
 public:
  // Times must increase. Sigmas of one axis.
  void add(double time_s, const Eigen::Vector2d& difference_m, double receiver_sigma_m, double vision_sigma_m);
  double statistic() const;

 private:
  struct Onset {
    double since_s;
    bool drift;
    Eigen::Vector2d response = Eigen::Vector2d::Zero();  // of the filter's (s / σ_s, v / σ_v), to u = 1
    double information = 0;                              // Σ g² / S
    Eigen::Vector2d score = Eigen::Vector2d::Zero();     // Σ g ν / S
  };

  double time_s_ = -1e9, next_onset_s_ = -1e9;
  double level_ = 1;                                 // of the innovations' squares, over their variance
  Eigen::Matrix2d state_ = Eigen::Matrix2d::Zero();  // rows s / σ_s and v / σ_v, columns east and north
  Eigen::Matrix2d covariance_ = Eigen::Matrix2d::Identity();
  std::deque<Onset> onsets_;
};

}  // namespace nadir::bench
