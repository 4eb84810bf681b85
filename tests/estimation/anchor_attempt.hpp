// An attempt at an anchor, for tests of the gates.
#pragma once

#include "estimation/anchor_acceptance.hpp"

namespace nadir::test {

// An anchor that passes every gate with room to spare; each test takes one thing away.
struct Attempt {
  AnchorMatch match;
  AnchorPrior prior;
  AnchorPrediction prediction{1, 20, true};
  GateLimits limits;

  Attempt() {
    match.search.places.resize(3);
    match.search.places.front().score = 0.4;
    match.search.ratio = 0.5;
    match.solved.emplace();
    match.solved->pose = prior.search.pose;
    match.solved->inliers = 50;
    match.solved->rms_m = 0.5;
    match.patches = 90;
    match.frame_share = 0.8;
    match.fine_gsd_m = 0.5;
    prior.tilt_covariance_rad2 = Eigen::Matrix2d::Identity() * 4e-4;
    prior.log_agl_sigma = 0.05;
  }
  AnchorVerdict verdict() const { return evaluate_anchor(match, prior, prediction, limits); }
};

}  // namespace nadir::test
