// What the belief gets of a match: its candidate, and the rival that may be the place instead.
#include "estimation/map_look.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "base/random.hpp"
#include "estimation/look_likelihood.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {
namespace {

using namespace parameters::anchor_measurement;

LookContext context_at(PlanePoint middle) {
  LookContext context;
  context.prior.search.pose = {middle, 100, {}};
  context.prior.search.radius_m = 120;
  context.window = {middle.east_m - 120, middle.north_m - 120, middle.east_m + 120, middle.north_m + 120};
  context.agl_m = 100;
  return context;
}

// Most patches agree at the first of two places of these scores.
AnchorMatch match_of(double best, double second) {
  AnchorMatch match;
  match.search.places = {{{{10, 20}, 100, {}}, best, best}, {{{10, -30}, 100, {}}, second, second}};
  match.search.ratio = second / best;
  match.fine_gsd_m = 0.5, match.coarse_gsd_m = 1;
  match.patches = 90;
  match.frame_share = 0.9;
  SolvedPose& solved = match.solved.emplace();
  solved.pose = {{12, 21}, 101, {}};
  solved.covariance.setIdentity();
  solved.inliers = 80;
  solved.rms_m = 0.5;
  return match;
}

TEST(MapLook, TheSecondBestPlaceIsTheRivalWhereTheSearchFoundIt) {
  const Look look = look_of(match_of(0.6, 0.57), context_at({0, 0}));
  ASSERT_TRUE(look.candidate && look.rival);
  EXPECT_EQ(look.candidate->position.north_m, 21);
  EXPECT_EQ(look.rival->position.east_m, 10);
  EXPECT_EQ(look.rival->position.north_m, -30);
  EXPECT_DOUBLE_EQ(look.rival->covariance_m2(0, 0) - look.candidate->covariance_m2(0, 0),
                   kRivalSigma_px * kRivalSigma_px)
      << "it was searched, not solved";
  EXPECT_DOUBLE_EQ(look.rival->log_likelihood_ratio, look.candidate->log_likelihood_ratio + rival_log_odds(0.57 / 0.6));
}

TEST(MapLook, TheLessItLooksLikeTheFrameTheLessItIsWorth) {
  EXPECT_LT(rival_log_odds(1), 0) << "patches agree at the candidate";
  double last = rival_log_odds(1);
  for (double ratio = 0.95; ratio >= 0; ratio -= 0.05) {
    EXPECT_LT(rival_log_odds(ratio), last);
    last = rival_log_odds(ratio);
  }
}

// Rows of fields: patches agree a row beside the place, nearer than a rival may be.
TEST(MapLook, TheMorePatchesAgreeTheSurerAndMoreHaveToWhereGroundResemblesItself) {
  const auto added_m2 = [](double ratio, int inliers) {
    AnchorMatch match = match_of(0.6, 0.6 * ratio);
    match.solved->inliers = inliers;  // of 90
    const Look look = look_of(match, context_at({0, 0}));
    const double others_m2 = anchor_model_error_factor(false) + unmodelled_variance_m2(100);
    EXPECT_NEAR(look.candidate->covariance_m2(0, 0) - others_m2, wrong_consensus_variance_m2(match), 1e-9);
    return wrong_consensus_variance_m2(match);
  };
  EXPECT_DOUBLE_EQ(added_m2(0.5, 20), 25) << "10 px of 0.5 m";
  EXPECT_DOUBLE_EQ(added_m2(0.5, 45), 25);
  EXPECT_EQ(added_m2(0.5, 59), 0);
  EXPECT_DOUBLE_EQ(added_m2(1, 71), 25);
  EXPECT_EQ(added_m2(1, 86), 0);
  for (int inliers = 40; inliers < 88; ++inliers) {
    for (double ratio = 0.6; ratio < 0.97; ratio += 0.02) {
      const double here_m = std::sqrt(added_m2(ratio, inliers));
      EXPECT_LE(std::sqrt(added_m2(ratio, inliers + 1)), here_m);
      EXPECT_GE(std::sqrt(added_m2(ratio + 0.02, inliers)), here_m);
      EXPECT_NEAR(std::sqrt(added_m2(ratio, inliers + 1)), here_m, 0.4) << "no step: one patch of 90";
      EXPECT_NEAR(std::sqrt(added_m2(ratio + 0.02, inliers)), here_m, 1.4);
    }
  }
}

// A prediction tells a wrong consensus by where it is, as far as it is sharper than that is wide.
TEST(MapLook, ASharpPredictionSaysWhetherThePatchesAreTheWrongOnes) {
  constexpr double kVariance_m2 = 25, kWidest_m2 = kVariance_m2 / kWrongConsensusChance;
  const auto left_m2 = [](double sigma_m, double off_m) {
    return wrong_consensus_left_m2(kVariance_m2, sigma_m * sigma_m * Eigen::Matrix2d::Identity(), {0, off_m});
  };
  EXPECT_NEAR(left_m2(1000, 10), kVariance_m2, 0.01) << "a vague one says nothing";
  EXPECT_LT(left_m2(2, 0), 1);
  EXPECT_NEAR(left_m2(2, 13), kWidest_m2, 1) << "a row beside the place";
  EXPECT_GT(left_m2(8, 13), kVariance_m2 / 2) << "8 m confirm no place 13 m off";
  EXPECT_EQ(left_m2(1, 1e6), kWidest_m2) << "no overflow";
  for (double sigma_m = 1; sigma_m < 20; ++sigma_m) {
    EXPECT_LT(left_m2(sigma_m, 0), left_m2(sigma_m + 1, 0)) << "the vaguer it is the less it says";
  }
  EXPECT_EQ(wrong_consensus_left_m2(0, Eigen::Matrix2d::Identity(), {0, 30}), 0) << "most patches agree";
}

// Of drawn places, some of them wrong, the mean variance of those that lie as far from the prediction.
TEST(MapLook, WhatIsLeftOfAWrongConsensusIsItsMeanVariance) {
  Random random(1);
  constexpr double kVariance_m2 = 36, kSigma_m = 7, kWidest_m2 = kVariance_m2 / kWrongConsensusChance;
  std::array<double, 5> drawn{}, sum_m2{}, left_m2{};
  for (int i = 0; i < 400'000; ++i) {
    const double wrong_m2 = random.chance(kWrongConsensusChance) ? kWidest_m2 : 0;
    const double sigma_m = std::sqrt(kSigma_m * kSigma_m + wrong_m2);
    const Eigen::Vector2d off_m(random.normal(0, sigma_m), random.normal(0, sigma_m));
    const auto band = static_cast<std::size_t>(off_m.norm() / 6);
    if (band >= drawn.size()) continue;
    ++drawn[band];
    sum_m2[band] += wrong_m2;
    left_m2[band] += wrong_consensus_left_m2(kVariance_m2, kSigma_m * kSigma_m * Eigen::Matrix2d::Identity(), off_m);
  }
  for (std::size_t band = 0; band < drawn.size(); ++band) {
    EXPECT_NEAR(left_m2[band] / drawn[band], sum_m2[band] / drawn[band], kWidest_m2 * 2 / std::sqrt(drawn[band]));
  }
}

TEST(MapLook, WithoutASecondPlaceThereIsNone) {
  AnchorMatch match = match_of(0.6, 0.3);
  match.search.places.pop_back();
  match.search.ratio = 1;
  EXPECT_FALSE(look_of(match, context_at({0, 0})).rival);
  match.solved.reset();
  const Look nothing = look_of(match, context_at({0, 0}));
  EXPECT_FALSE(nothing.candidate || nothing.rival);
}

TEST(MapLook, WhatAnotherMatcherSaysOfTheCandidateIsNotSaidOfItsRival) {
  AnchorMatch match = match_of(0.6, 0.57);
  const Look alone = look_of(match, context_at({0, 0}));
  match.judged_log_likelihood_ratio = alone.candidate->log_likelihood_ratio + 3;
  const Look confirmed = look_of(match, context_at({0, 0}));
  EXPECT_DOUBLE_EQ(confirmed.rival->log_likelihood_ratio, alone.rival->log_likelihood_ratio);
  match.judged_log_likelihood_ratio = alone.candidate->log_likelihood_ratio - 3;
  const Look contradicted = look_of(match, context_at({0, 0}));
  EXPECT_DOUBLE_EQ(contradicted.rival->log_likelihood_ratio, alone.rival->log_likelihood_ratio - 3);
}

}  // namespace
}  // namespace nadir
