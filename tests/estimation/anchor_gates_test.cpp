#include "estimation/anchor_acceptance.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "estimation/anchor_attempt.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

using test::Attempt;

TEST(AnchorGates, AcceptsWhatPassesAll) { EXPECT_EQ(Attempt().verdict(), AnchorVerdict::accepted); }

TEST(AnchorGates, NoMap) {
  Attempt attempt;
  attempt.match.on_map = false;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::no_map);
}

TEST(AnchorGates, AmbiguousBeyondTheVoteRatio) {
  Attempt attempt;
  attempt.match.search.ratio = attempt.limits.vote_ratio;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "a healthy prediction is the second voice";
  attempt.match.search.ratio = attempt.limits.vote_ratio + 1e-6;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::ambiguous);
}

TEST(AnchorGates, NothingFoundIsAmbiguous) {
  Attempt attempt;
  attempt.match.search.places.clear();
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::ambiguous);
}

TEST(AnchorGates, FewInliers) {
  Attempt attempt;
  attempt.match.patches = 20;
  attempt.match.solved->inliers = attempt.limits.min_inliers;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted);
  attempt.match.solved->inliers = attempt.limits.min_inliers - 1;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::few_inliers);
}

TEST(AnchorGates, FewInliersOfMany) {
  Attempt attempt;
  // The less clear the place, the more patches must agree: with less than that, not even votes help.
  const GateLimits& limits = attempt.limits;
  attempt.prediction.sigma_m = limits.sharp_sigma_m + 1;
  for (const auto& [ratio, share] : {std::pair{limits.clear_ratio, limits.clear_inlier_share},
                                     {limits.alone_ratio, limits.alone_inlier_share},
                                     {limits.vote_ratio, limits.vote_inlier_share}}) {
    attempt.match.search.ratio = ratio;
    attempt.match.patches = 100;
    attempt.match.solved->inliers = static_cast<int>(std::lround(100 * share));
    EXPECT_EQ(attempt.verdict(), AnchorVerdict::awaiting_votes) << ratio;
    attempt.match.patches = 104;
    EXPECT_EQ(attempt.verdict(), AnchorVerdict::few_inliers) << ratio;
  }
}

TEST(AnchorGates, ASharpPredictionAndACloseFitNeedFewer) {
  Attempt attempt;
  const GateLimits& limits = attempt.limits;
  attempt.match.search.ratio = limits.vote_ratio;
  attempt.match.patches = 100;
  attempt.match.solved->inliers = static_cast<int>(std::lround(100 * limits.alone_inlier_share));
  attempt.match.solved->rms_m = limits.max_chance_residual_px * attempt.match.fine_gsd_m;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted);
  const Attempt corroborated = attempt;
  attempt.match.solved->rms_m *= 1.01;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::few_inliers) << "they fit as chance does";
  attempt = corroborated;
  attempt.prediction.sigma_m = limits.sharp_sigma_m + 1;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::few_inliers) << "a vague prediction is no second voice";
  attempt = corroborated;
  attempt.prediction.chi2 = limits.chi2_999 + 1;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::few_inliers) << "it says something else";
}

TEST(AnchorGates, FaintLikeness) {
  for (const bool sharp : {false, true}) {
    Attempt attempt;
    attempt.prediction.sigma_m = attempt.limits.sharp_sigma_m + (sharp ? 0 : 1e-6);
    double& score = attempt.match.search.places.front().score;
    score = sharp ? attempt.limits.min_sharp_score : attempt.limits.min_score;
    EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted);
    score -= 1e-6;
    EXPECT_EQ(attempt.verdict(), AnchorVerdict::ambiguous) << "nothing here looks like the frame";
  }
}

TEST(AnchorGates, NotSolvedIsFewInliers) {
  Attempt attempt;
  attempt.match.solved.reset();
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::few_inliers);
}

TEST(AnchorGates, PatchesInOneCorner) {
  Attempt attempt;
  attempt.match.frame_share = attempt.limits.min_frame_share;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted);
  attempt.match.frame_share -= 1e-6;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::bad_geometry);
}

TEST(AnchorGates, LargeResidual) {
  Attempt attempt;
  attempt.match.solved->rms_m = attempt.limits.max_residual_px * attempt.match.fine_gsd_m;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted);
  attempt.match.solved->rms_m += 1e-6;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::bad_geometry);
}

// Beside the belief's own sigma, roofs and rolling ground feign 0.015 rad and 1.5 %.
TEST(AnchorGates, IncredibleTilt) {
  // Two axes: their root mean square counts, so that one axis alone may be off by √2 times the limit.
  const double bound = std::sqrt(2.0) * GateLimits().max_tilt_sigmas * std::hypot(0.02, 0.015);
  for (const double sign : {-1.0, 1.0}) {
    Attempt attempt;
    attempt.match.solved->pose.attitude.roll_rad += sign * 0.999 * bound;
    EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted);
    attempt.match.solved->pose.attitude.roll_rad += sign * 0.002 * bound;
    EXPECT_EQ(attempt.verdict(), AnchorVerdict::bad_geometry);
  }
}

TEST(AnchorGates, IncredibleHeight) {
  for (const double sign : {-1.0, 1.0}) {
    Attempt attempt;
    attempt.match.solved->pose.agl_m *= std::exp(sign * 3.99 * std::hypot(0.05, 0.015));
    EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted);
    attempt.match.solved->pose.agl_m *= std::exp(sign * 0.02 * std::hypot(0.05, 0.015));
    EXPECT_EQ(attempt.verdict(), AnchorVerdict::bad_geometry);
  }
}

TEST(AnchorGates, SurpriseIsTheWorstOfTiltAndHeight) {
  Attempt attempt;
  EXPECT_EQ(attitude_deviation_sigmas(*attempt.match.solved, attempt.prior), 0);
  attempt.match.solved->pose.attitude.pitch_rad += 2 * std::hypot(0.02, 0.015);
  attempt.match.solved->pose.attitude.roll_rad += 2 * std::hypot(0.02, 0.015);
  EXPECT_NEAR(attitude_deviation_sigmas(*attempt.match.solved, attempt.prior), 2, 1e-9);
  attempt.match.solved->pose.agl_m *= std::exp(3 * std::hypot(0.05, 0.015));
  EXPECT_NEAR(attitude_deviation_sigmas(*attempt.match.solved, attempt.prior), 3, 1e-9);
}

TEST(AnchorGates, LostItMustStandOutFurther) {
  Attempt attempt;
  attempt.prediction = {0, 1000, false, true};
  attempt.match.search.ratio = attempt.limits.lost_ratio;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted);
  attempt.match.search.ratio += 1e-6;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::awaiting_votes);
  attempt.match.search.ratio = 0.3;
  attempt.prior.search.radius_m = attempt.limits.telling_window_m;
  attempt.match.solved->inliers = 17;  // of 90: enough with a position, not without one
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::awaiting_votes);
  attempt.prediction.lost = false;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted);
}

TEST(AnchorGates, OffAHealthyPrediction) {
  Attempt attempt;
  attempt.prediction.chi2 = attempt.limits.chi2_999;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted);
  attempt.prediction.chi2 = attempt.limits.chi2_999 + 1e-6;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::off_prediction);
}

// The filter owns up to a broken track with a larger sigma: what lies beyond that is off, too. Lost, there is nothing
// to be off.
TEST(AnchorGates, OffABrokenPrediction) {
  Attempt attempt;
  attempt.prediction = {1000, 200, false};
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::off_prediction);
  attempt.prediction.lost = true;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted);
}

TEST(Names, EveryLabelAndVerdictHasItsOwn) {
  std::vector<std::string_view> names;
  for (int i = 0; i <= static_cast<int>(SourceLabel::no_fix); ++i)
    names.push_back(name_of(static_cast<SourceLabel>(i)));
  EXPECT_THAT(names, testing::ElementsAre("satellite_anchored", "vo_extrapolated", "dead_reckoned", "no_fix"));
  std::vector<std::string_view> verdicts;
  for (int i = 0; i <= static_cast<int>(AnchorVerdict::awaiting_votes); ++i) {
    verdicts.push_back(name_of(static_cast<AnchorVerdict>(i)));
  }
  EXPECT_THAT(verdicts, testing::ElementsAre("not_tried", "accepted", "frame_unfit", "no_map", "ambiguous",
                                             "few_inliers", "bad_geometry", "off_prediction", "awaiting_votes"));
}

}  // namespace
}  // namespace nadir
