// What passes every bound and is not enough by itself: it awaits votes.
#include <gtest/gtest.h>

#include "estimation/anchor_attempt.hpp"

namespace nadir {
namespace {

using test::Attempt;

// Patches that scatter over all of the solver's bound agree by chance, or a map that has changed in part pulls at them.
TEST(AnchorGates, ALooseFitAwaitsVotes) {
  Attempt attempt;
  const GateLimits& limits = attempt.limits;
  attempt.match.search.ratio = limits.clear_ratio + 0.01;
  attempt.match.patches = 100;
  attempt.match.solved->inliers = 49;
  attempt.match.solved->rms_m = (limits.max_chance_residual_px + 0.01) * attempt.match.fine_gsd_m;
  attempt.prediction = {1, 50, true};
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::awaiting_votes);
  const Attempt loose = attempt;
  attempt.prediction.sigma_m = limits.sharp_sigma_m;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "a sharp prediction says the same";
  attempt = loose;
  attempt.match.solved->inliers = 50;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "most agree";
  attempt = loose;
  attempt.match.solved->rms_m = limits.max_chance_residual_px * attempt.match.fine_gsd_m;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "they agree closely";
  attempt = loose;
  attempt.match.search.ratio = limits.clear_ratio - 0.1;
  attempt.prior.search.radius_m = limits.telling_window_m - 1;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::awaiting_votes) << "in a small window few places compete";
  attempt.prior.search.radius_m = limits.telling_window_m;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "of many places none came near";
}

TEST(AnchorGates, FewPatchesAwaitVotes) {
  Attempt attempt;
  const GateLimits& limits = attempt.limits;
  attempt.match.search.ratio = limits.clear_ratio - 0.1;
  attempt.match.patches = 100;
  attempt.match.solved->inliers = 39;
  attempt.prediction = {1, 50, true};
  attempt.prior.search.radius_m = limits.telling_window_m - 1;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::awaiting_votes);
  const Attempt few = attempt;
  attempt.match.solved->inliers = 40;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "enough agree";
  attempt = few;
  attempt.prediction.sigma_m = limits.sharp_sigma_m;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "a sharp prediction says the same";
  attempt.prediction.chi2 = limits.expected_chi2 + 0.01;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::awaiting_votes) << "a sharp prediction says something else";
  attempt = few;
  attempt.prior.search.radius_m = limits.telling_window_m;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "of many places none came near";
  attempt = few;
  attempt.prediction = {1000, 1000, false, true};
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::awaiting_votes) << "lost, nothing speaks for them either";
}

TEST(AnchorGates, NotManyWhereNobodyExpectedThemAwaitVotes) {
  Attempt attempt;
  const GateLimits& limits = attempt.limits;
  attempt.match.search.ratio = limits.clear_ratio + 0.01;
  attempt.match.patches = 100;
  attempt.match.solved->inliers = 49;
  attempt.prediction = {limits.expected_chi2 + 0.01, 50, true};
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::awaiting_votes);
  const Attempt unexpected = attempt;
  attempt.prediction.chi2 = limits.expected_chi2;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "where they were expected";
  attempt = unexpected;
  attempt.match.solved->inliers = 50;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "most agree";
  attempt = unexpected;
  attempt.prediction = {1000, 1000, false, true};
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "lost, nothing was expected";
}

TEST(AnchorGates, OneFrameIsNotEnoughAgainstAStart) {
  Attempt attempt;
  attempt.prediction = {attempt.limits.expected_chi2 + 0.01, 20, false};
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "it is a prediction from an anchor";
  attempt.prediction.first = true;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::awaiting_votes);
  attempt.prediction.chi2 = attempt.limits.expected_chi2;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted);
  attempt.prediction.odometry_linked = true;
  attempt.prediction.chi2 = attempt.limits.chi2_99;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "odometry led here: it is no picture of another place";
  attempt.prediction.chi2 = attempt.limits.chi2_99 + 0.01;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::awaiting_votes);
  attempt.prediction = {1000, 1000, false, true, true};
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "without a start there is nothing to be against";
}

TEST(AnchorGates, WithAnOpenTiltMostMustAgree) {
  Attempt attempt;
  const GateLimits& limits = attempt.limits;
  attempt.prediction = {1, 50, false};
  attempt.match.patches = 100;
  attempt.match.solved->inliers = 49;
  const double variance = limits.open_tilt_rad * limits.open_tilt_rad;
  attempt.prior.tilt_covariance_rad2 = Eigen::Matrix2d::Identity() * variance * 0.99;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted);
  attempt.prior.tilt_covariance_rad2 = Eigen::Matrix2d::Identity() * variance * 1.01;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::awaiting_votes);
  attempt.match.solved->inliers = 50;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted);
}

TEST(AnchorGates, AFrameThatDoesNotContinueTheLastOneAwaitsVotes) {
  for (const bool lost : {false, true}) {
    Attempt attempt;
    attempt.prediction = {1, lost ? 1000.0 : 5, !lost, lost};
    EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted);
    attempt.prediction.tracking_broken = true;
    EXPECT_EQ(attempt.verdict(), AnchorVerdict::awaiting_votes) << "however clear: one of the two shows another place";
  }
}

TEST(AnchorGates, SecondedBySharpPredictionsThatSayTheSame) {
  const GateLimits limits;
  const AnchorPrediction sharp{limits.expected_chi2, limits.sharp_sigma_m, true};
  EXPECT_TRUE(corroborated(sharp));
  AnchorPrediction other = sharp;
  other.healthy = false;
  EXPECT_FALSE(corroborated(other)) << "the track has been broken";
  other = sharp;
  other.sigma_m += 1e-6;
  EXPECT_FALSE(corroborated(other)) << "vague";
  other = sharp;
  other.chi2 += 1e-6;
  EXPECT_FALSE(corroborated(other)) << "it says something else";
}

TEST(AnchorGates, AVoteNeedsASecondVoice) {
  Attempt attempt;
  attempt.prediction.healthy = false;
  attempt.match.search.ratio = attempt.limits.alone_ratio;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "clear enough alone";
  attempt.match.search.ratio = attempt.limits.alone_ratio + 1e-6;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::awaiting_votes) << "however many patches agree";
  attempt.prediction.healthy = true;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "the prediction agrees";
}

}  // namespace
}  // namespace nadir
