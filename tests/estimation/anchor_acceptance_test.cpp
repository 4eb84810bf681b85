#include "estimation/anchor_acceptance.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "geodesy/angles.hpp"

namespace nadir {
namespace {

// An anchor that passes every gate with margin; each test changes one property.
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

// ---- Gates

TEST(AnchorGates, AcceptsWhatPassesAll) { EXPECT_EQ(Attempt().verdict(), AnchorVerdict::accepted); }

TEST(AnchorGates, NoMap) {
  Attempt attempt;
  attempt.match.on_map = false;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::no_map);
}

TEST(AnchorGates, AmbiguousBeyondTheVoteRatio) {
  Attempt attempt;
  attempt.match.search.ratio = attempt.limits.vote_ratio;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "a healthy prediction is the second vote";
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
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::few_inliers) << "residuals as of a chance consensus";
  attempt = corroborated;
  attempt.prediction.sigma_m = limits.sharp_sigma_m + 1;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::few_inliers) << "an uncertain prediction is no second vote";
  attempt = corroborated;
  attempt.prediction.chi2 = limits.chi2_999 + 1;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::few_inliers) << "it disagrees";
}

TEST(AnchorGates, LowScore) {
  for (const bool sharp : {false, true}) {
    Attempt attempt;
    attempt.prediction.sigma_m = attempt.limits.sharp_sigma_m + (sharp ? 0 : 1e-6);
    double& score = attempt.match.search.places.front().score;
    score = sharp ? attempt.limits.min_sharp_score : attempt.limits.min_score;
    EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted);
    score -= 1e-6;
    EXPECT_EQ(attempt.verdict(), AnchorVerdict::ambiguous) << "no place here looks like the frame";
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

// Beside the estimate's own sigma, roofs and rolling ground look like 0.015 rad and 1.5 %.
TEST(AnchorGates, ImplausibleTilt) {
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

TEST(AnchorGates, ImplausibleHeight) {
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

TEST(AnchorGates, WithoutAPositionItMustBeMoreDistinctive) {
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

// The filter states a larger sigma after a broken track: what lies beyond that is off, too. Without a position
// there is no prediction to be off from.
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

// ---- Matches that pass every threshold but await votes

// Patches that scatter over all of the solver's bound agree by chance, or support a wrong pose on a partly changed map.
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
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "a sharp prediction agrees";
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
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "clear in a window where many places compete";
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
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "a sharp prediction agrees";
  attempt.prediction.chi2 = limits.expected_chi2 + 0.01;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::awaiting_votes) << "a sharp prediction disagrees";
  attempt = few;
  attempt.prior.search.radius_m = limits.telling_window_m;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "clear in a window where many places compete";
  attempt = few;
  attempt.prediction = {1000, 1000, false, true};
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::awaiting_votes)
      << "without a position no prediction supports them either";
}

TEST(AnchorGates, NotManyAwayFromThePredictionAwaitVotes) {
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
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "without a position nothing was expected";
}

TEST(AnchorGates, OneFrameIsNotEnoughAgainstAStart) {
  Attempt attempt;
  attempt.prediction = {attempt.limits.expected_chi2 + 0.01, 20, false};
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "it is a prediction from an anchor";
  attempt.prediction.before_first_anchor = true;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::awaiting_votes);
  attempt.prediction.chi2 = attempt.limits.expected_chi2;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted);
  attempt.prediction.odometry_linked = true;
  attempt.prediction.chi2 = attempt.limits.chi2_99;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "odometry links it: it is no image of another place";
  attempt.prediction.chi2 = attempt.limits.chi2_99 + 0.01;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::awaiting_votes);
  attempt.prediction = {1000, 1000, false, true, true};
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "without a start there is nothing to contradict";
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

TEST(AnchorGates, CorroboratedBySharpPredictionsThatAgree) {
  const GateLimits limits;
  const AnchorPrediction sharp{limits.expected_chi2, limits.sharp_sigma_m, true};
  EXPECT_TRUE(corroborated(sharp));
  AnchorPrediction other = sharp;
  other.healthy = false;
  EXPECT_FALSE(corroborated(other)) << "the track has been broken";
  other = sharp;
  other.sigma_m += 1e-6;
  EXPECT_FALSE(corroborated(other)) << "an uncertain prediction";
  other = sharp;
  other.chi2 += 1e-6;
  EXPECT_FALSE(corroborated(other)) << "it disagrees";
}

TEST(AnchorGates, AVoteNeedsASecondFrame) {
  Attempt attempt;
  attempt.prediction.healthy = false;
  attempt.match.search.ratio = attempt.limits.alone_ratio;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "clear enough alone";
  attempt.match.search.ratio = attempt.limits.alone_ratio + 1e-6;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::awaiting_votes) << "however many patches agree";
  attempt.prediction.healthy = true;
  EXPECT_EQ(attempt.verdict(), AnchorVerdict::accepted) << "the prediction agrees";
}

// ---- Votes

constexpr PlanePoint kHere;

bool vote(AnchorVotes& votes, double east_m, double north_m, const Quorum& quorum = {}) {
  return votes.vote({east_m, north_m}, kHere, quorum);
}

TEST(AnchorVotes, ThreeThatAgreeAreEnough) {
  AnchorVotes votes;
  EXPECT_FALSE(vote(votes, 100, 50));
  EXPECT_FALSE(vote(votes, 110, 60));
  EXPECT_TRUE(vote(votes, 95, 45));
}

TEST(AnchorVotes, OtherAttemptsInBetweenDoNotMatterButAgeDoes) {
  AnchorVotes votes;
  EXPECT_FALSE(vote(votes, 100, 50));
  EXPECT_FALSE(vote(votes, -700, 3));
  EXPECT_FALSE(vote(votes, 101, 50));
  votes.abstain(kHere);
  EXPECT_TRUE(vote(votes, 99, 52)) << "the first of five still counts";
  AnchorVotes late;
  EXPECT_FALSE(vote(late, 100, 50));
  EXPECT_FALSE(vote(late, 101, 50));
  for (int i = 0; i < 4; ++i) late.abstain(kHere);
  EXPECT_FALSE(vote(late, 100, 50)) << "too long ago";
}

TEST(AnchorVotes, AgainstAnAnchorItTakesSixOfEight) {
  const Quorum quorum{.required_votes = AnchorVotes::kVotesAgainstAnchors};
  AnchorVotes votes;
  for (int i = 0; i < 3; ++i) EXPECT_FALSE(vote(votes, 200, 0, quorum)) << i;
  votes.abstain(kHere);
  votes.abstain(kHere);
  for (int i = 0; i < 2; ++i) EXPECT_FALSE(vote(votes, 205, 3, quorum)) << i;
  EXPECT_TRUE(vote(votes, 201, 1, quorum));
  AnchorVotes late;
  for (int i = 0; i < 5; ++i) EXPECT_FALSE(vote(late, 200, 0, quorum)) << i;
  for (int i = 0; i < 3; ++i) late.abstain(kHere);
  EXPECT_FALSE(vote(late, 200, 0, quorum)) << "five of the last eight";
}

TEST(AnchorVotes, DisagreementIsNoVote) {
  AnchorVotes votes;
  for (int i = 0; i < 20; ++i) EXPECT_FALSE(vote(votes, 26.0 * i, 0)) << i;
}

TEST(AnchorVotes, FramesOverTheSameGroundAreOneVote) {
  const Quorum quorum{.min_separation_m = 150};
  AnchorVotes votes;
  for (int i = 0; i < 3; ++i) EXPECT_FALSE(votes.vote({40, 0}, {60.0 * i, 0}, quorum)) << i;
  EXPECT_TRUE(votes.vote({40, 0}, {180, 0}, quorum));
}

// Three images a second, 7 m apart, each of which shows 500 m: eight attempts in a row take two seconds and count as
// one vote.
TEST(AnchorVotes, DistanceCountsNotTheFrameRate) {
  for (const int required : {AnchorVotes::kVotes, AnchorVotes::kVotesAgainstAnchors}) {
    const Quorum quorum{.required_votes = required, .min_separation_m = 400};
    AnchorVotes votes;
    double way_m = 0;
    for (int i = 0; !votes.vote({40, 0}, {way_m, 0}, quorum); ++i) {
      ASSERT_LT(way_m, 600) << required;
      way_m += 7;
      if (i % 4 == 3) votes.abstain({way_m, 0});
    }
    EXPECT_GE(way_m, 400) << required;
  }
}

TEST(AnchorVotes, AttemptsKeptAreBounded) {
  AnchorVotes votes;
  const Quorum quorum{.min_separation_m = 100};
  EXPECT_FALSE(votes.vote({40, 0}, {0, 0}, quorum));
  EXPECT_FALSE(votes.vote({40, 0}, {60, 0}, quorum));
  for (int i = 0; i < 100'000; ++i) votes.abstain({90, 0});
  EXPECT_FALSE(votes.vote({40, 0}, {120, 0}, quorum));
}

TEST(AnchorVotes, InASmallWindowTheyMustAgreeCloser) {
  EXPECT_EQ(AnchorVotes::agreement_radius_m(1200), AnchorVotes::kAgreement_m);
  EXPECT_NEAR(AnchorVotes::agreement_radius_m(60), 6.8, 0.1);
  const Quorum quorum{.agreement_radius_m = AnchorVotes::agreement_radius_m(60)};
  AnchorVotes votes;
  EXPECT_FALSE(vote(votes, 40, 0, quorum));
  EXPECT_FALSE(vote(votes, 44, 0, quorum));
  EXPECT_FALSE(vote(votes, 48, 0, quorum)) << "the first is 8 m off";
}

TEST(AnchorVotes, ABreakClearsVotes) {
  AnchorVotes votes;
  vote(votes, 1, 1);
  vote(votes, 1, 1);
  votes.clear();
  EXPECT_FALSE(vote(votes, 1, 1));
  EXPECT_FALSE(vote(votes, 1, 1));
  EXPECT_TRUE(vote(votes, 1, 1));
}

// ---- Start contradictions

TEST(StartContradictions, WithoutAnyAMatchHasItsOwnChi2) {
  EXPECT_EQ(StartContradictions().effective_chi2({50, 0}, 3, 8), 3);
}

// 50 m at a sigma of 8 m, while odometry makes the prediction more uncertain.
TEST(StartContradictions, APropagatedContradictionKeepsItsLargestChi2) {
  StartContradictions contradictions;
  contradictions.record({10, 49}, 27, 9.5);
  contradictions.record({9, 48}, 18, 11);
  EXPECT_EQ(contradictions.effective_chi2({9, 48}, 12.9, 13), 27);
  EXPECT_EQ(contradictions.effective_chi2({9, 48}, 30, 13), 30) << "its own when that is worse";
  EXPECT_EQ(contradictions.effective_chi2({-30, 5}, 4, 13), 4) << "another place";
}

TEST(StartContradictions, DriftWidensThePlaceByTheGrowthOfSigma) {
  StartContradictions contradictions;
  contradictions.record({0, 60}, 30, 10);
  EXPECT_EQ(contradictions.effective_chi2({0, 100}, 5, 10), 5);
  EXPECT_EQ(contradictions.effective_chi2({0, 100}, 5, 16), 30);
}

TEST(StartContradictions, ChanceMatchesElsewhereDoNotDisplaceItSoon) {
  StartContradictions contradictions;
  contradictions.record({0, 60}, 30, 10);
  for (int i = 0; i < 7; ++i) contradictions.record({100.0 + 60 * i, -200}, 20, 10);
  EXPECT_EQ(contradictions.effective_chi2({0, 60}, 5, 10), 30);
  contradictions.record({-300, 0}, 20, 10);
  EXPECT_EQ(contradictions.effective_chi2({0, 60}, 5, 10), 5) << "memory is bounded";
}

TEST(StartContradictions, IsClearedWhenResolved) {
  StartContradictions contradictions;
  contradictions.record({0, 60}, 30, 10);
  contradictions.clear();
  EXPECT_EQ(contradictions.effective_chi2({0, 60}, 5, 10), 5);
}

}  // namespace
}  // namespace nadir
