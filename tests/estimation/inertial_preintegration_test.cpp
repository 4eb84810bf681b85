#include "estimation/inertial_preintegration.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "base/random.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kRate_hz = 100;

// A rolling, yawing body that is pulled about.
InertialSample felt(double time_s) {
  return {time_s,
          {0.4 * std::sin(2 * time_s), 0.1 * std::cos(3 * time_s), 0.25},
          {2 * std::sin(time_s), 1 + 0.5 * std::cos(2 * time_s), -9.8 + 0.7 * std::sin(3 * time_s)}};
}

// The mean over the time since the sample before, from many readings.
InertialSample sample_at(double time_s, double rate_hz = kRate_hz) {
  constexpr int kReadings = 20;
  InertialSample mean{time_s, Vector3d::Zero(), Vector3d::Zero()};
  for (int i = 0; i < kReadings; ++i) {
    const InertialSample reading = felt(time_s - (i + 0.5) / kReadings / rate_hz);
    mean.rate_rad_s += reading.rate_rad_s / kReadings;
    mean.force_mps2 += reading.force_mps2 / kReadings;
  }
  return mean;
}

std::vector<InertialSample> samples_of(double seconds, double rate_hz = kRate_hz) {
  std::vector<InertialSample> samples;
  for (int i = 1; i <= std::lround(seconds * rate_hz); ++i) samples.push_back(sample_at(i / rate_hz, rate_hz));
  return samples;
}

std::vector<InertialSample> with_error(std::vector<InertialSample> samples, const InertialBias& bias) {
  for (InertialSample& sample : samples) {
    sample.rate_rad_s += bias.rate_rad_s;
    sample.force_mps2 += bias.force_mps2;
  }
  return samples;
}

double apart_rad(const Matrix3d& a, const Matrix3d& b) { return rotation_vector_of(a.transpose() * b).norm(); }

TEST(Preintegration, IsTheIntegralOfWhatTheBodyDid) {
  Matrix3d turn = Matrix3d::Identity();
  Vector3d velocity = Vector3d::Zero(), way = Vector3d::Zero();
  constexpr double kBrute_s = 1e-5;  // by brute force
  for (int i = 0; i < 200'000; ++i) {
    const InertialSample now = felt((i + 0.5) * kBrute_s);
    const Vector3d gained = turn * rotation_of(now.rate_rad_s * kBrute_s / 2) * now.force_mps2 * kBrute_s;
    way += velocity * kBrute_s + gained * kBrute_s / 2;
    velocity += gained;
    turn = turn * rotation_of(now.rate_rad_s * kBrute_s);
  }
  const auto motion = preintegrate(samples_of(2), 0, 2);
  ASSERT_TRUE(motion);
  EXPECT_NEAR(motion->seconds, 2, 1e-12);
  EXPECT_LT(apart_rad(motion->turn, turn), 1e-5);
  EXPECT_LT((motion->velocity_change_mps - velocity).norm(), 1e-3);
  EXPECT_LT((motion->displacement_m - way).norm(), 1e-3);
  const auto slower = preintegrate(samples_of(2, 50), 0, 2);
  ASSERT_TRUE(slower);
  EXPECT_LT((slower->displacement_m - way).norm(), 4e-3);
}

TEST(Preintegration, OtherBiasesNeedNoOtherSum) {
  const InertialBias bias{{0.004, -0.006, 0.005}, {0.1, -0.2, 0.15}};
  const auto spoilt = with_error(samples_of(1), bias);
  const auto exact = preintegrate(spoilt, 0, 1, bias), plain = preintegrate(spoilt, 0, 1);
  ASSERT_TRUE(exact && plain);
  const PreintegratedMotion moved = plain->with_bias(bias);
  EXPECT_GT(apart_rad(plain->turn, exact->turn), 5e-3);
  EXPECT_LT(apart_rad(moved.turn, exact->turn), 5e-5);
  EXPECT_GT((plain->displacement_m - exact->displacement_m).norm(), 0.1);
  EXPECT_LT((moved.velocity_change_mps - exact->velocity_change_mps).norm(), 2e-3);
  EXPECT_LT((moved.displacement_m - exact->displacement_m).norm(), 1e-3);
}

TEST(Preintegration, TheCovarianceIsThatOfManySums) {
  using namespace parameters::inertial;
  const auto clean = samples_of(1);
  const auto exact = preintegrate(clean, 0, 1);
  ASSERT_TRUE(exact);
  Eigen::Matrix<double, 9, 9> scatter = Eigen::Matrix<double, 9, 9>::Zero();
  Random random(4);
  constexpr int kSums = 1500;
  for (int i = 0; i < kSums; ++i) {
    auto noisy = clean;
    for (InertialSample& sample : noisy) {
      for (double& rate : sample.rate_rad_s) rate += random.normal(0, kRateNoise_rad_s * std::sqrt(kRate_hz));
      for (double& force : sample.force_mps2) force += random.normal(0, kForceNoise_mps2 * std::sqrt(kRate_hz));
    }
    const auto sum = preintegrate(noisy, 0, 1);
    ASSERT_TRUE(sum);
    Eigen::Matrix<double, 9, 1> off;
    off << rotation_vector_of(exact->turn.transpose() * sum->turn),
        sum->velocity_change_mps - exact->velocity_change_mps, sum->displacement_m - exact->displacement_m;
    scatter += off * off.transpose() / kSums;
  }
  for (int i = 0; i < 9; ++i) {
    EXPECT_NEAR(scatter(i, i), exact->covariance(i, i), 0.15 * exact->covariance(i, i)) << i;
  }
  EXPECT_NEAR(scatter(3, 6), exact->covariance(3, 6), 0.15 * exact->covariance(3, 6));
}

TEST(Preintegration, PartsAreTheWhole) {
  const auto samples = samples_of(5);
  const auto whole = preintegrate(samples, 0.123, 4.567);
  const auto parts = preintegrate_parts(samples, 0.123, 4.567);
  ASSERT_TRUE(whole);
  ASSERT_EQ(parts.size(), 5U);
  PreintegratedMotion sum;
  for (const PreintegratedMotion& part : parts) {
    EXPECT_LE(part.seconds, parameters::inertial::kMaxPart_s + 1e-9);
    sum.displacement_m += sum.velocity_change_mps * part.seconds + sum.turn * part.displacement_m;
    sum.velocity_change_mps += sum.turn * part.velocity_change_mps;
    sum.turn = (sum.turn * part.turn).eval();
    sum.seconds += part.seconds;
  }
  EXPECT_NEAR(sum.seconds, whole->seconds, 1e-9);
  EXPECT_LT(apart_rad(sum.turn, whole->turn), 1e-4);
  EXPECT_LT((sum.displacement_m - whole->displacement_m).norm(), 0.01);
}

TEST(Preintegration, AGapIsNoMotion) {
  const auto samples = samples_of(3);
  EXPECT_TRUE(preintegrate_parts({}, 0, 1).empty());
  EXPECT_TRUE(preintegrate_parts(samples, 1, 1).empty());
  EXPECT_TRUE(preintegrate_parts(samples, 2, 1).empty()) << "a clock that ran back";
  EXPECT_TRUE(preintegrate_parts(samples, 0, 1e9).empty());
  EXPECT_TRUE(preintegrate_parts(samples, std::numeric_limits<double>::quiet_NaN(), 1).empty());
  EXPECT_FALSE(preintegrate_parts(samples, 0, 3.07).empty()) << "the last sample holds a little longer";
  EXPECT_TRUE(preintegrate_parts(samples, 0, 3.2).empty());
  EXPECT_TRUE(preintegrate_parts(samples, -0.2, 1).empty());
  auto torn = samples;
  torn.erase(torn.begin() + 100, torn.begin() + 106);
  EXPECT_FALSE(preintegrate_parts(torn, 0, 3).empty()) << "six lost ones";
  torn.erase(torn.begin() + 100, torn.begin() + 110);
  EXPECT_TRUE(preintegrate_parts(torn, 0, 3).empty());
  EXPECT_EQ(preintegrate_parts(torn, 1.5, 3).size(), 2U) << "the rest is whole";
}

TEST(Preintegration, UnusableSamplesAreLeftOut) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN(), kInfinite = std::numeric_limits<double>::infinity();
  const InertialSample good = felt(1.01);
  const auto altered = [&](double time_s, int axis, double rate, double force) {
    InertialSample sample = felt(time_s);
    sample.rate_rad_s[axis] += rate;
    sample.force_mps2[axis] += force;
    return sample;
  };
  const std::vector<InertialSample> offered = {
      altered(0.99, 0, 0, 0),  // of the time before
      altered(1, 0, 0, 0),     // at its end
      good,
      good,                            // once more
      altered(1.005, 0, 0, 0),         // late
      altered(1.02, 1, kNan, 0),       // no number
      altered(1.03, 2, 0, kInfinite),  // nor this
      altered(1.04, 0, 34.9, 0),       // saturated
      altered(1.05, 2, 0, -156.9),     // likewise
      altered(kNan, 0, 0, 0),
      altered(1.06, 0, 1, 20),  // fast, hard, and true
  };
  const auto usable = usable_samples(offered, 1);
  ASSERT_EQ(usable.size(), 2U);
  EXPECT_EQ(usable[0].time_s, 1.01);
  EXPECT_EQ(usable[1].time_s, 1.06);
}

TEST(Preintegration, RotationsAndTheirVectors) {
  for (const Vector3d& vector :
       {Vector3d(0, 0, 0), Vector3d(1e-7, 0, -2e-7), Vector3d(0.3, -1, 0.2), Vector3d(0, 0, 3)}) {
    const Matrix3d rotation = rotation_of(vector);
    EXPECT_LT((rotation * rotation.transpose() - Matrix3d::Identity()).norm(), 1e-12);
    EXPECT_LT((rotation_vector_of(rotation) - vector).norm(), 1e-9);
  }
  EXPECT_LT((rotation_of({0, 0, 0.5}) * Vector3d(1, 0, 0) - Vector3d(std::cos(0.5), std::sin(0.5), 0)).norm(), 1e-12);
}

}  // namespace
}  // namespace nadir
