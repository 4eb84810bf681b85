// The delay from turns and samples that the test makes itself: an aircraft that banks into turns of 20° a second and
// out of them, a gyroscope that is late, biased and noisy.
#include "provision/gyro_delay.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "geodesy/angles.hpp"
#include "vision/camera.hpp"

namespace nadir {
namespace {

constexpr double kSampleEvery_s = 0.01, kFrameEvery_s = 0.5, kTurnSigma_rad = 0.002;

// Clockwise, rad/s: straight for ten seconds, a turn of six, and so on, to both sides.
double rate_at(double time_s) {
  const double within_s = std::fmod(time_s, 16);
  if (within_s < 10) return 0;
  const double side = std::fmod(time_s, 32) < 16 ? 1 : -1;
  return side * radians(20) * std::min(1.0, std::min(within_s - 10, 16 - within_s));
}

struct Sensors {
  double delay_s = 0.08;
  Eigen::Vector3d bias_rad_s{0.002, -0.004, 0.007};
  Eigen::Vector3d mount_rad{0.012, -0.015, 0.02};
  double flown_s = 60;
  bool turns = true;
};

// Banked as a coordinated turn at 22 m/s needs it; the heading is summed up in steps of a millisecond.
class Path {
 public:
  explicit Path(const Sensors& sensors) : turns_(sensors.turns) {
    for (double heading = 0, t = 0; t < sensors.flown_s; t += kStep_s) {
      headings_.push_back(heading);
      heading += kStep_s * rate(t + kStep_s / 2);
    }
  }
  Attitude at(double time_s) const {
    const double steps = time_s / kStep_s;
    const auto before = static_cast<std::size_t>(steps);
    const double share = steps - static_cast<double>(before);
    const double heading = headings_[before] + share * (headings_[before + 1] - headings_[before]);
    return {heading, radians(2), std::atan(22 * rate(time_s) / 9.81)};
  }

 private:
  static constexpr double kStep_s = 0.001;
  double rate(double time_s) const { return turns_ ? rate_at(time_s) : 0; }

  bool turns_;
  std::vector<double> headings_;
};

std::vector<InertialSample> samples_of(const Sensors& sensors) {
  const Path path(sensors);
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0, radians(0.03));
  Eigen::Matrix3d samples_from_camera;  // image-up, image-right, optical axis
  samples_from_camera << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  samples_from_camera = (samples_from_camera * rotation_of(-sensors.mount_rad)).eval();
  std::vector<InertialSample> samples;
  for (double t = kSampleEvery_s; t < sensors.flown_s - 1; t += kSampleEvery_s) {
    const Eigen::Matrix3d before = enu_from_camera(path.at(t - kSampleEvery_s)), now = enu_from_camera(path.at(t));
    const Eigen::Vector3d rate = rotation_vector_of(before.transpose() * now) / kSampleEvery_s;
    const Eigen::Vector3d noises(noise(random), noise(random), noise(random));
    samples.push_back({t, samples_from_camera * rate + sensors.bias_rad_s + noises, {0, 0, -9.8}});
  }
  return samples;
}

// A frame that is stamped t was taken at t less the delay. Images know the heading well, and tilt less.
std::vector<ImageTurn> turns_of(const Sensors& sensors) {
  const Path path(sensors);
  std::mt19937 random(6);
  std::normal_distribution<double> normal;
  const auto seen = [&](double time_s) {
    Attitude attitude = path.at(time_s - sensors.delay_s);
    attitude.pitch_rad += 3 * kTurnSigma_rad * normal(random);
    attitude.roll_rad += 3 * kTurnSigma_rad * normal(random);
    attitude.heading_rad += kTurnSigma_rad * normal(random);
    return attitude;
  };
  std::vector<ImageTurn> turns;
  for (double t = 2; t + kFrameEvery_s < sensors.flown_s - 3; t += kFrameEvery_s) {
    ImageTurn turn{t, t + kFrameEvery_s, seen(t), seen(t + kFrameEvery_s)};
    turn.covariance_rad2 = 2 * kTurnSigma_rad * kTurnSigma_rad * Eigen::Vector3d(9, 9, 1).asDiagonal().toDenseMatrix();
    turns.push_back(turn);
  }
  return turns;
}

TEST(GyroDelay, IsFoundWithItsSignUnderBiasesAndASkewMount) {
  for (const double delay_s : {0.08, -0.12, 0.45}) {
    const Sensors sensors{.delay_s = delay_s};
    const auto found = solve_gyro_delay(turns_of(sensors), samples_of(sensors));
    ASSERT_TRUE(found);
    EXPECT_LT(found->sigma_s, 0.005);
    EXPECT_NEAR(found->delay_s, delay_s, 3.5 * found->sigma_s);
    EXPECT_LT((found->bias_rad_s - sensors.bias_rad_s).norm(), 0.004) << found->bias_rad_s;
  }
}

TEST(GyroDelay, SetsWrongPairsAside) {
  const Sensors sensors;
  std::vector<ImageTurn> turns = turns_of(sensors);
  for (std::size_t i = 0; i < turns.size(); i += 10) turns[i].now.heading_rad += 0.3;
  const auto found = solve_gyro_delay(turns, samples_of(sensors));
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->delay_s, sensors.delay_s, 3.5 * found->sigma_s);
  EXPECT_GE(found->outliers, turns.size() / 10);
}

TEST(GyroDelay, AStraightFlightDoesNotTellIt) {
  const Sensors sensors{.turns = false};
  const auto found = solve_gyro_delay(turns_of(sensors), samples_of(sensors));
  EXPECT_TRUE(!found || found->sigma_s > 0.05) << found->sigma_s;
}

TEST(GyroDelay, ADelayBeyondTheRangeAndOtherAxesAreNoResult) {
  Sensors late{.delay_s = 0.7};
  EXPECT_FALSE(solve_gyro_delay(turns_of(late), samples_of(late)));
  const Sensors sensors;
  std::vector<InertialSample> turned = samples_of(sensors);
  for (InertialSample& sample : turned) sample.rate_rad_s = -sample.rate_rad_s;  // as if mounted upside down
  EXPECT_FALSE(solve_gyro_delay(turns_of(sensors), turned));
}

TEST(GyroDelay, IsNotGuessedFromTooLittle) {
  const Sensors sensors;
  const std::vector<ImageTurn> turns = turns_of(sensors);
  std::vector<InertialSample> samples = samples_of(sensors);
  EXPECT_FALSE(solve_gyro_delay({}, samples));
  EXPECT_FALSE(solve_gyro_delay({turns.begin(), turns.begin() + 5}, samples));
  EXPECT_FALSE(solve_gyro_delay(turns, {}));
  samples.resize(300);  // three seconds
  EXPECT_FALSE(solve_gyro_delay(turns, samples));
}

TEST(GyroDelay, SamplesOfAFlightAreInOrderOfTime) {
  Flight flight;
  flight.frames.resize(2);
  const auto sample = [](double time_s) { return InertialSample{.time_s = time_s}; };
  flight.frames[0].inertial = {sample(0.1), sample(0.2)};
  flight.frames[1].inertial = {sample(0.2), sample(std::nan("")), sample(0.3)};
  const auto samples = inertial_samples(flight);
  ASSERT_EQ(samples.size(), 3U);
  EXPECT_EQ(samples.back().time_s, 0.3);
}

}  // namespace
}  // namespace nadir
