#include "fixes/fix_predictor.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "base/random.hpp"
#include "geodesy/local_frame.hpp"

namespace nadir {
namespace {

constexpr LonLat kOrigin{8.5, 47.25};
constexpr std::int64_t kSecond = 1'000'000;

class Prediction : public ::testing::Test {
 protected:
  // 20 m/s eastwards from the origin at time 0, with an error to the north.
  VisionEstimate on_track(double time_s, double north_error_m = 0, double sigma_m = 3) const {
    return {.time_us = std::llround(time_s * 1e6),
            .place = frame_.lonlat_from_plane({20 * time_s, north_error_m}),
            .sigma_m = sigma_m,
            .east_mps = 20,
            .speed_sigma_mps = 0.5};
  }
  PlanePoint place_of(const PredictedFix& predicted) const { return frame_.plane_from_lonlat(predicted.fix->place); }
  // Level flight straight on, or pushed to the left, until then.
  void feel(double until_s) {
    for (; felt_s_ < until_s; felt_s_ += 0.05) {
      predictor_.on_message(std::llround(felt_s_ * 1e6), AircraftAttitude{.yaw_rad = std::numbers::pi / 2});
      predictor_.on_message(std::llround(felt_s_ * 1e6), ImuSample{.acceleration_mps2 = {0, -left_m_s2_, -9.8}});
    }
  }
  PredictedFix at(double time_s) {
    if (feels_) feel(time_s);
    auto predicted = predictor_.poll(std::llround(time_s * 1e6), 0);
    EXPECT_TRUE(predicted) << time_s;
    return predicted.value_or(PredictedFix{});
  }

  LocalFrame frame_{kOrigin};
  FixPredictor predictor_;
  bool feels_ = true;
  double felt_s_ = 0, left_m_s2_ = 0;
};

TEST_F(Prediction, ThereIsNoFixBeforeTheFirstEstimate) {
  const PredictedFix predicted = at(1);
  EXPECT_FALSE(predicted.fix);
  EXPECT_FALSE(predicted.jumped_m);
}

TEST_F(Prediction, TenFixesPerSecondOnAGridThatLatePollsDoNotShift) {
  Random random(3);
  std::vector<std::int64_t> sent;
  for (std::int64_t now_us = kSecond; now_us < 61 * kSecond; now_us += random.integer(500, 30'000)) {
    if (predictor_.poll(now_us, 0)) sent.push_back(now_us);
  }
  EXPECT_EQ(sent.size(), 600U);
  for (std::size_t i = 1; i < sent.size(); ++i) EXPECT_LE(sent[i] - sent[i - 1], 130'000);
}

TEST_F(Prediction, AfterAStallThereAreNoBursts) {
  predictor_.poll(kSecond, 0);
  EXPECT_TRUE(predictor_.poll(5 * kSecond, 0));
  EXPECT_FALSE(predictor_.poll(5 * kSecond + 1, 0));
  EXPECT_FALSE(predictor_.poll(5 * kSecond + 99'999, 0));
  EXPECT_TRUE(predictor_.poll(5 * kSecond + 100'000, 0));
}

TEST_F(Prediction, NewEstimatesDoNotWaitForTheGrid) {
  predictor_.poll(kSecond, 0);
  ASSERT_TRUE(predictor_.on_estimate(on_track(1), kSecond + 10'000));
  EXPECT_FALSE(predictor_.poll(kSecond + 39'999, 0)) << "too soon after the last one";
  EXPECT_EQ(predictor_.next_due_us(), kSecond + 40'000);
  EXPECT_TRUE(predictor_.poll(kSecond + 40'000, 0));
  EXPECT_FALSE(predictor_.poll(kSecond + 139'999, 0));
  EXPECT_TRUE(predictor_.poll(kSecond + 140'000, 0)) << "never longer without";
}

TEST_F(Prediction, ALaterEstimateOfTheSameFrameReplacesIt) {
  ASSERT_TRUE(predictor_.on_estimate(on_track(1, 0, 20), kSecond));
  at(1.1);
  ASSERT_TRUE(predictor_.on_estimate(on_track(1, 8, 2), kSecond + 200'000)) << "the map has spoken about that picture";
  at(1.2);
  EXPECT_NEAR(place_of(at(4)).north_m, 8, 0.01);
}

TEST_F(Prediction, PropagatesTheEstimateWithGrowingSigma) {
  VisionEstimate estimate = on_track(1);
  estimate.msl_m = 600;
  estimate.down_mps = -2;
  ASSERT_TRUE(predictor_.on_estimate(estimate, kSecond + 80'000));
  double sigma_m = 0;
  for (double time_s = 1.1; time_s < 5; time_s += 0.1) {
    const PredictedFix predicted = at(time_s);
    ASSERT_TRUE(predicted.fix);
    EXPECT_NEAR(place_of(predicted).east_m, 20 * time_s, 1e-3);
    EXPECT_NEAR(place_of(predicted).north_m, 0, 1e-3);
    EXPECT_NEAR(*predicted.fix->msl_m, 600 + 2 * (time_s - 1), 1e-9);
    EXPECT_EQ(predicted.fix->velocity->east_mps, 20);
    EXPECT_EQ(predicted.fix->velocity->down_mps, -2);
    EXPECT_GT(predicted.fix->sigma_m, sigma_m);
    sigma_m = predicted.fix->sigma_m;
  }
  // After 4 s: 3 m, 0.5 m/s and 0.5 m/s² of which none is known better.
  EXPECT_NEAR(sigma_m, std::hypot(3, 0.5 * 4.0, 0.25 * 4.0 * 4.0), 0.1);
}

TEST_F(Prediction, AnUnknownVerticalVelocityIsNotZero) {
  ASSERT_TRUE(predictor_.on_estimate(on_track(1), kSecond + 80'000));
  const PredictedFix predicted = at(1.2);
  ASSERT_TRUE(predicted.fix && predicted.fix->velocity);
  EXPECT_FALSE(predicted.fix->velocity->down_mps);
}

TEST_F(Prediction, InABlackoutTheFixTurnsWithTheAircraft) {
  feel(1);
  predictor_.on_estimate(on_track(1), kSecond + 200'000);
  left_m_s2_ = 3;
  const PredictedFix predicted = at(6);
  ASSERT_TRUE(predicted.fix);
  EXPECT_NEAR(place_of(predicted).north_m, 0.5 * 3 * 5 * 5, 1);
  EXPECT_NEAR(place_of(predicted).east_m, 20 * 6, 1);
  EXPECT_NEAR(predicted.fix->velocity->north_mps, 15, 0.2);
}

TEST_F(Prediction, WithoutAccelerometersSigmaAllowsForATurn) {
  feels_ = false;
  predictor_.on_estimate(on_track(1), kSecond);
  at(1.1);
  const Fix fix = *at(5).fix;
  EXPECT_NEAR(fix.sigma_m, std::hypot(std::hypot(3, 0.5 * 4), 0.25 * 4 * 4, 0.5 * 2.5 * 4 * 4), 0.01);
  EXPECT_NEAR(*fix.speed_sigma_mps, std::hypot(0.5, 0.5 * 4, 2.5 * 4), 0.01);
  EXPECT_FALSE(at(25).fix) << "five hundred metres are none";
}

TEST_F(Prediction, CorrectionsRampAndSigmaCoversTheRest) {
  predictor_.on_estimate(on_track(1), kSecond);
  PlanePoint before = place_of(at(1.1));
  predictor_.on_estimate(on_track(1.15, 20), 1'150'000);
  double time_s = 1.2;
  for (int i = 0; i < 60; ++i, time_s += 0.1) {
    const PredictedFix predicted = at(time_s);
    ASSERT_TRUE(predicted.fix);
    EXPECT_FALSE(predicted.jumped_m);
    const PlanePoint now = place_of(predicted);
    // Continuous: what the aircraft flies in 0.1 s and no more than 5 m/s beside it.
    EXPECT_NEAR(now.east_m - before.east_m, 2, 1e-3);
    EXPECT_LE(std::abs(now.north_m - before.north_m), 0.5 + 1e-3) << time_s;
    const double missing_m = std::abs(20 - now.north_m);
    EXPECT_NEAR(predicted.ramp_left_m, missing_m, 1e-3);
    EXPECT_GE(predicted.fix->sigma_m, std::hypot(3, missing_m) - 1e-6);
    before = now;
  }
  EXPECT_NEAR(before.north_m, 20, 1e-3) << "it ends where the estimate is";
}

TEST_F(Prediction, ANewCorrectionStartsFromTheLastFix) {
  predictor_.on_estimate(on_track(1), kSecond);
  at(1.1);
  double north_m = 0, time_s = 1.2;
  for (int i = 0; i < 40; ++i, time_s += 0.1) {  // estimates that scatter on both sides, faster than the ramps end
    predictor_.on_estimate(on_track(time_s - 0.04, i % 2 == 0 ? 15 : -15), std::llround(time_s * 1e6) - 10'000);
    const PlanePoint now = place_of(at(time_s));
    EXPECT_LE(std::abs(now.north_m - north_m), 0.5 + 1e-3) << time_s;
    north_m = now.north_m;
  }
}

TEST_F(Prediction, LargeCorrectionsJumpOnceAndAreReported) {
  predictor_.on_estimate(on_track(1), kSecond);
  at(1.1);
  predictor_.on_estimate(on_track(1.15, 300), 1'150'000);
  const PredictedFix jumped = at(1.2);
  EXPECT_NEAR(place_of(jumped).north_m, 300, 1e-3);
  EXPECT_NEAR(*jumped.jumped_m, 300, 0.1);
  EXPECT_EQ(jumped.ramp_left_m, 0);
  EXPECT_FALSE(at(1.3).jumped_m);
}

TEST_F(Prediction, NoFixAfterTheBlackoutLimitAndADirectStartAfterIt) {
  predictor_.on_estimate(on_track(1), kSecond);
  for (double time_s = 1.1; time_s < 31.0; time_s += 0.1) EXPECT_TRUE(at(time_s).fix) << time_s;
  EXPECT_FALSE(at(31.2).fix);
  predictor_.on_estimate(on_track(31.25, 30), 31'250'000);
  const PredictedFix again = at(31.3);
  EXPECT_NEAR(place_of(again).north_m, 30, 1e-3) << "there is nothing to be continuous with";
  EXPECT_FALSE(again.jumped_m);
}

TEST_F(Prediction, DeadReckoningDoesNotEndABlackout) {
  predictor_.on_estimate(on_track(1), kSecond);
  for (double time_s = 2; time_s < 40; time_s += 1) {
    VisionEstimate estimate = on_track(time_s, 0, 3 + time_s);
    estimate.visual = false;
    EXPECT_TRUE(predictor_.on_estimate(estimate, estimate.time_us));
  }
  EXPECT_FALSE(at(40).fix);
}

TEST_F(Prediction, DeadReckoningLessAccurateThanTheAccelerometersChangesNothing) {
  feel(1);
  predictor_.on_estimate(on_track(1), kSecond);
  feel(5);
  VisionEstimate estimate = on_track(5, 80, 60);
  estimate.visual = false;
  EXPECT_TRUE(predictor_.on_estimate(estimate, 5 * kSecond));
  const PredictedFix kept = at(5.1);
  EXPECT_NEAR(place_of(kept).north_m, 0, 0.5);
  EXPECT_FALSE(kept.jumped_m);
  estimate.time_us += 100'000;
  estimate.sigma_m = 2;
  EXPECT_TRUE(predictor_.on_estimate(estimate, 5 * kSecond + 100'000));
  EXPECT_TRUE(at(5.2).jumped_m) << "surer it counts";
}

TEST_F(Prediction, NoFixBeyondTheLargestSigma) {
  predictor_.on_estimate(on_track(1, 0, 501), kSecond);
  EXPECT_FALSE(at(1.1).fix);
  predictor_.on_estimate(on_track(1.2, 0, 499), 1'200'000);
  EXPECT_TRUE(at(1.2).fix);
}

TEST_F(Prediction, OldFutureOrInvalidEstimatesChangeNothing) {
  ASSERT_TRUE(predictor_.on_estimate(on_track(2), 2 * kSecond));
  EXPECT_FALSE(predictor_.on_estimate(on_track(1.9, 40), 2 * kSecond));
  EXPECT_FALSE(predictor_.on_estimate(on_track(3, 40), 2 * kSecond));
  for (int i = 0; i < 6; ++i) {
    VisionEstimate estimate = on_track(2.1, 40);
    if (i == 0) estimate.sigma_m = std::nan("");
    if (i == 1) estimate.sigma_m = -1;
    if (i == 2) estimate.place.lat_deg = std::nan("");
    if (i == 3) estimate.east_mps = INFINITY;
    if (i == 4) estimate.speed_sigma_mps = std::nan("");
    if (i == 5) estimate.place.lon_deg = 200;
    EXPECT_FALSE(predictor_.on_estimate(estimate, 3 * kSecond)) << i;
  }
  EXPECT_NEAR(place_of(at(2.2)).north_m, 0, 1e-3);
}

}  // namespace
}  // namespace nadir
