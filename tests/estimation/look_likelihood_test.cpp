#include "estimation/look_likelihood.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "base/digest.hpp"
#include "base/error.hpp"
#include "base/files.hpp"
#include "base/random.hpp"
#include "bench/likelihood_fit.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

using bench::TrainingLook;
using bench::TrainingSet;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

// A match as a clear picture of the true place gives it.
struct MatchedLook {
  AnchorMatch match;
  AnchorPrior prior;

  MatchedLook() {
    match.search.places.resize(2);
    match.search.places.front().score = 0.5;
    match.search.ratio = 0.3;
    match.solved.emplace();
    match.solved->inliers = 72;
    match.solved->rms_m = 0.6;
    match.solved->pose.agl_m = prior.search.pose.agl_m;
    match.patches = 96;
    match.frame_share = 0.9;
    match.fine_gsd_m = 0.5;
    match.coarse_gsd_m = 1.5;
    prior.search.radius_m = 100;
    prior.search.heading_range_rad = 2 * kHeadingStep_rad;
    prior.search.scale_range = kScaleStep;
    prior.tilt_covariance_rad2 = Eigen::Matrix2d::Identity() * 0.01;
  }
  LookFeatures features() const { return features_of(match, prior, 4 * 100 * 100); }
};

LookFeatures good_look() { return MatchedLook().features(); }

LookFeatures poor_look() {
  LookFeatures look = good_look();
  look.ratio = 0.97, look.score = 0.1, look.inlier_share = 0.08, look.inliers = 8, look.residual_px = 2.2;
  look.frame_share = 0.3, look.shift_px = 12, look.deviation_sigmas = 2;
  return look;
}

// ---- Features

TEST(LookFeatures, AreThoseOfTheMatch) {
  MatchedLook look;
  look.match.search.places.front().pose.position = {9, 12};  // the solved one stands at (0, 0)
  look.match.search.places.front().pose.agl_m = look.match.solved->pose.agl_m;
  const LookFeatures features = look.features();
  EXPECT_EQ(features.ratio, 0.3);
  EXPECT_EQ(features.score, 0.5);
  EXPECT_EQ(features.inlier_share, 0.75);
  EXPECT_EQ(features.inliers, 72);
  EXPECT_NEAR(features.residual_px, 1.2, 1e-12);
  EXPECT_EQ(features.frame_share, 0.9);
  EXPECT_NEAR(features.shift_px, 10, 1e-9) << "15 m at 1.5 m a pixel";
  EXPECT_EQ(features.deviation_sigmas, 0);
  EXPECT_NEAR(features.tilt_sigma_rad, 0.1, 1e-12);
  EXPECT_NEAR(features.ln_poses, std::log(5 * 3), 1e-9) << "five headings, three heights";
  EXPECT_NEAR(features.ln_places, std::log(200 * 200 / (25.0 * 25)), 1e-9);
}

// Turning the camera about its position moves the ground that it looks at; so does moving the camera.
TEST(LookFeatures, ShiftIsThatOfTheGroundUnderTheAxis) {
  MatchedLook look;
  CameraPose& solved = look.match.solved->pose;
  solved.attitude.pitch_rad = 0.1;  // looks north of where it stands
  solved.position = {0, -solved.agl_m * std::tan(0.1)};
  look.match.search.places.front().pose.agl_m = solved.agl_m;
  EXPECT_NEAR(look.features().shift_px, 0, 1e-9);
}

TEST(LookFeatures, CoarserMatchingTellsFewerPlacesApart) {
  MatchedLook look;
  look.match.coarse_gsd_m = 10;  // distinct from 120 m on
  const double area_m2 = 2000 * 2000;
  EXPECT_NEAR(features_of(look.match, look.prior, area_m2).ln_places, std::log(area_m2 / (120 * 120)), 1e-9);
}

// The matcher widens a window that is too small to hold a rival.
TEST(LookFeatures, ASmallWindowHasThePlacesThatTheMatcherSearches) {
  const MatchedLook look;
  const double least = std::pow(2 * kMinWindowDistinct, 2);
  EXPECT_NEAR(features_of(look.match, look.prior, 1).ln_places, std::log(least), 1e-9);
  EXPECT_NEAR(features_of(look.match, look.prior, 0).ln_places, std::log(least), 1e-9);
}

TEST(LookFeatures, WithoutAPoseThereAreNone) {
  MatchedLook look;
  look.match.solved.reset();
  EXPECT_THROW(look.features(), Error);
  MatchedLook empty;
  empty.match.search.places.clear();
  EXPECT_THROW(empty.features(), Error);
}

TEST(LookFeatures, DeviationIsInSigmasOfThePrior) {
  MatchedLook look;
  look.prior.tilt_covariance_rad2 = Eigen::Matrix2d::Identity() * 0.04 * 0.04;
  look.match.solved->pose.attitude.roll_rad = 0.2;
  const double sigma = std::hypot(0.04, parameters::anchor_measurement::kTiltModelError_rad);
  EXPECT_NEAR(attitude_deviation_sigmas(*look.match.solved, look.prior), 0.2 / sigma / std::sqrt(2), 1e-9);
}

// ---- Curves

TEST(MonotoneCurve, InterpolatesAndStaysConstantBeyondItsKnots) {
  const MonotoneCurve curve{3, {1, 2, 4}, {0, 1, 5}};
  EXPECT_EQ(curve(0), 0);
  EXPECT_EQ(curve(1.5), 0.5);
  EXPECT_EQ(curve(2), 1);
  EXPECT_EQ(curve(3), 3);
  EXPECT_EQ(curve(4), 5);
  EXPECT_EQ(curve(1e9), 5);
  EXPECT_EQ(MonotoneCurve()(7), 0);
}

TEST(MonotoneCurve, NotANumberIsTheWeakestEvidence) {
  EXPECT_EQ((MonotoneCurve{2, {0, 1}, {-1, 3}}(kNan)), -1);
  EXPECT_EQ((MonotoneCurve{2, {0, 1}, {3, -1}}(kNan)), -1);
}

// ---- The table in force

// Physics' sign of every feature: more of it speaks for the place (+1) or against it (−1).
constexpr std::array<int, LookFeatures::kCount> kSigns = {-1, 1, 1, 1, -1, 1, -1, -1, -1, -1, -1};

TEST(LookLikelihoodTable, EveryCurveHasTheSignOfPhysics) {
  const LookLikelihoodTable& table = look_likelihood_table();
  for (std::size_t i = 0; i < LookFeatures::kCount; ++i) {
    const MonotoneCurve& curve = table.curves[i];
    for (std::size_t k = 1; k < static_cast<std::size_t>(curve.knots); ++k) {
      EXPECT_GT(curve.at[k], curve.at[k - 1]) << LookFeatures::names[i];
      EXPECT_GE(kSigns[i] * (curve.value[k] - curve.value[k - 1]), 0) << LookFeatures::names[i];
    }
  }
  const MonotoneCurve& psi = table.ratio_by_places;
  for (std::size_t k = 0; k < static_cast<std::size_t>(psi.knots); ++k) {
    EXPECT_GE(psi.value[k], 0);
    if (k > 0) {
      EXPECT_LE(psi.value[k], psi.value[k - 1]);
    }
  }
}

TEST(LookLikelihoodTable, SeparatesAGoodLookFromAPoorOne) {
  EXPECT_GT(log_likelihood_ratio(good_look()), 3);
  EXPECT_LT(log_likelihood_ratio(poor_look()), -1);
}

TEST(LookLikelihoodTable, ClaimsNoMoreThanItsTrainingHasSeen) {
  const LookLikelihoodTable& table = look_likelihood_table();
  EXPECT_NEAR(table.limit, std::log(table.chance_looks / 3.0), 1e-4);
  LookFeatures perfect = good_look();
  perfect.ratio = 0, perfect.score = 1, perfect.inlier_share = 1, perfect.inliers = 96, perfect.residual_px = 0;
  perfect.frame_share = 1, perfect.shift_px = 0;
  EXPECT_LE(log_likelihood_ratio(perfect), table.limit);
  LookFeatures worst = poor_look();
  worst.ratio = 1, worst.score = 0, worst.inliers = 0, worst.inlier_share = 0, worst.deviation_sigmas = kInfinity;
  EXPECT_GE(log_likelihood_ratio(worst), -table.limit);
}

TEST(LookLikelihoodTable, WhatIsNoNumberIsNoEvidenceForThePlace) {
  LookFeatures look = good_look();
  const double whole = log_likelihood_ratio(look);
  for (double LookFeatures::*feature : {&LookFeatures::ratio, &LookFeatures::score, &LookFeatures::inlier_share,
                                        &LookFeatures::inliers, &LookFeatures::residual_px, &LookFeatures::frame_share,
                                        &LookFeatures::shift_px, &LookFeatures::deviation_sigmas}) {
    LookFeatures broken = look;
    broken.*feature = kNan;
    EXPECT_LE(log_likelihood_ratio(broken), whole);
    EXPECT_TRUE(std::isfinite(log_likelihood_ratio(broken)));
  }
  LookFeatures all = {kNan, kNan, kNan, kNan, kNan, kNan, kNan, kNan, kNan, kNan, kNan};
  EXPECT_LT(log_likelihood_ratio(all), 0);
}

TEST(LookLikelihoodTable, SummandsAddUp) {
  const LookFeatures look = poor_look();
  double sum = 0;
  for (const double summand : evidence_by_feature(look)) sum += summand;
  const double limit = look_likelihood_table().limit;
  EXPECT_NEAR(log_likelihood_ratio(look), std::clamp(sum, -limit, limit), 1e-12);
}

// ---- Where the table comes from

class StoredLooks : public testing::Test {
 protected:
  static const std::string& bytes() {
    static const std::string stored = read_text_file(NADIR_TEST_DATA "/looks.bin");
    return stored;
  }
  static const TrainingSet& set() {
    static const TrainingSet looks = bench::unpacked(bytes(), "looks.bin");
    return looks;
  }
};

TEST_F(StoredLooks, GiveTheTableInForce) {
  const std::string digest = sha256(as_bytes(bytes())).hex();
  const auto fitted = bench::fit(set(), digest);
  const LookLikelihoodTable& table = look_likelihood_table();
  EXPECT_EQ(table.training_sha256, digest) << "other looks than those stored; to do: ./run bench fit-likelihood";
  EXPECT_EQ(table.training, fitted->table.training);
  const auto in_force = bench::numbers_of(table), again = bench::numbers_of(fitted->table);
  ASSERT_EQ(in_force.size(), again.size());
  for (std::size_t i = 0; i < again.size(); ++i) {
    EXPECT_NEAR(std::stod(in_force[i]), std::stod(again[i]), 1e-6)
        << "number " << i << "; to do: ./run bench fit-likelihood";
  }
}

TEST_F(StoredLooks, ATableThatWasEditedShows) {
  LookLikelihoodTable table = look_likelihood_table();
  EXPECT_EQ(table.numbers_sha256, bench::numbers_digest(table)) << "edited by hand? to do: ./run bench fit-likelihood";
  table.curves[1].value[2] += 1e-6;
  EXPECT_NE(table.numbers_sha256, bench::numbers_digest(table));
  table = look_likelihood_table();
  table.limit += 1e-5;
  EXPECT_NE(table.numbers_sha256, bench::numbers_digest(table));
  table = look_likelihood_table();
  table.training_sha256 = "another";
  EXPECT_NE(table.numbers_sha256, bench::numbers_digest(table));
}

// ---- Storing

TrainingSet two_looks() {
  TrainingSet set{"made for a test", {}};
  set.looks.push_back({true, true, true, bench::PictureKind::blur, good_look()});
  set.looks.push_back({false, false, false, bench::PictureKind::night, {}});
  return set;
}

TEST(PackedLooks, ComeBackRounded) {
  const TrainingSet back = bench::unpacked(bench::packed(two_looks()), "test");
  EXPECT_EQ(back.origin, "made for a test");
  ASSERT_EQ(back.looks.size(), 2U);
  EXPECT_TRUE(back.looks[0].candidate && back.looks[0].holds_place && back.looks[0].right);
  EXPECT_EQ(back.looks[0].picture, bench::PictureKind::blur);
  EXPECT_FALSE(back.looks[1].candidate || back.looks[1].holds_place || back.looks[1].right);
  EXPECT_EQ(back.looks[1].picture, bench::PictureKind::night);
  const auto stored = back.looks[0].features.values(), given = good_look().values();
  for (std::size_t i = 0; i < given.size(); ++i) EXPECT_NEAR(stored[i], given[i], 1e-2 * std::max(0.01, given[i]));
  EXPECT_EQ(bench::packed(back), bench::packed(bench::unpacked(bench::packed(back), "again"))) << "rounded once";
}

TEST(PackedLooks, ValuesBeyondWhatIsStoredAreLimited) {
  TrainingSet set = two_looks();
  set.looks[0].features.shift_px = 1e9;
  set.looks[0].features.score = -0.3;
  const LookFeatures back = bench::unpacked(bench::packed(set), "test").looks[0].features;
  EXPECT_NEAR(back.shift_px, 655.35, 1e-6);
  EXPECT_EQ(back.score, 0);
}

TEST(PackedLooks, DamagedFilesAreErrors) {
  const std::string whole = bench::packed(two_looks());
  EXPECT_THROW(bench::unpacked("", "test"), Error);
  EXPECT_THROW(bench::unpacked("nadir looks 2\nx\n", "test"), Error);
  EXPECT_THROW(bench::unpacked("nadir looks 1\nno end of line", "test"), Error);
  EXPECT_THROW(bench::unpacked(whole.substr(0, whole.size() - 5), "test"), Error);
  EXPECT_THROW(bench::unpacked(whole + '\xff', "test"), Error) << "a kind of picture that there is not";
  EXPECT_THROW(bench::unpacked(whole + '\x05', "test"), Error) << "right where the place is not";
}

// ---- The fit

// One feature of two normal distributions, one sigma wide and two apart: their log ratio is 2 x - 2, exactly.
TrainingSet normal_looks(int right, int chance, std::uint64_t seed) {
  Random random(seed);
  TrainingSet set{"two normal distributions", {}};
  for (int i = 0; i < right + chance; ++i) {
    TrainingLook look{true, i < right, i < right, bench::PictureKind::clear, {}};
    look.features.inliers = 20 + 10 * random.normal(i < right ? 2 : 0, 1);  // stored in whole numbers
    set.looks.push_back(look);
  }
  return set;
}

TEST(LikelihoodFit, FindsTheRatioOfTwoKnownDensities) {
  const auto fitted = bench::fit(normal_looks(4000, 8000, 3), "");
  for (const double x : {0.0, 0.5, 1.0, 1.5, 2.0}) {
    LookFeatures look;
    look.inliers = 20 + 10 * x;
    EXPECT_NEAR(log_likelihood_ratio(look, fitted->table), 2 * x - 2, 0.3) << x;
  }
}

// P(ratio > t | chance) <= 1 / t on looks that it has not seen.
TEST(LikelihoodFit, ChanceSeldomExceedsARatio) {
  const auto fitted = bench::fit(normal_looks(2000, 4000, 4), "");
  const TrainingSet unseen = bench::unpacked(bench::packed(normal_looks(1, 20'000, 5)), "unseen");
  for (const double t : {3.0, 10.0, 30.0, 100.0}) {
    int above = 0;
    for (std::size_t i = 1; i < unseen.looks.size(); ++i) {
      above += log_likelihood_ratio(unseen.looks[i].features, fitted->table) > std::log(t) ? 1 : 0;
    }
    EXPECT_LT(above, 20'000 / t) << t;
  }
}

TEST(LikelihoodFit, TheShareOfTrueLooksInTrainingIsNoEvidence) {
  const auto few = bench::fit(normal_looks(500, 8000, 6), ""), many = bench::fit(normal_looks(8000, 4000, 7), "");
  LookFeatures look;
  look.inliers = 30;
  EXPECT_NEAR(log_likelihood_ratio(look, few->table), log_likelihood_ratio(look, many->table), 0.3);
}

// What speaks against physics is chance: the curve stays flat.
TEST(LikelihoodFit, NeverTurnsASignAround) {
  TrainingSet set = normal_looks(2000, 2000, 8);
  for (TrainingLook& look : set.looks) look.features.residual_px = look.right ? 2 : 1;
  for (TrainingLook& look : set.looks) look.features.residual_px += 0.01 * look.features.inliers;
  const MonotoneCurve curve = bench::fit(set, "")->table.curves[4];
  for (std::size_t k = 0; k < static_cast<std::size_t>(curve.knots); ++k) EXPECT_EQ(curve.value[k], 0);
}

TEST(LikelihoodFit, TheSameLooksGiveTheSameBytes) {
  const TrainingSet set = normal_looks(300, 700, 9);
  const auto one = bench::fit(set, "digest"), other = bench::fit(set, "digest");
  EXPECT_EQ(bench::table_source(one->table), bench::table_source(other->table));
  EXPECT_EQ(one->table.numbers_sha256, bench::numbers_digest(one->table));
}

TEST(LikelihoodFit, OneKindOfLookAloneIsAnError) {
  EXPECT_THROW(bench::fit(normal_looks(0, 100, 1), ""), Error);
  EXPECT_THROW(bench::fit(normal_looks(100, 0, 1), ""), Error);
  EXPECT_THROW(bench::fit(TrainingSet{}, ""), Error);
}

}  // namespace
}  // namespace nadir
