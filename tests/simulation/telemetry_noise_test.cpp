#include "simulation/telemetry_noise.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "geodesy/angles.hpp"

namespace nadir {
namespace {

FlightPose pose_at(double time_s) {
  FlightPose pose;
  pose.time_s = time_s;
  pose.agl_m = pose.pressure_agl_m = 250;
  return pose;
}

// Over many flights each error has the camera file's sigma.
TEST(TelemetryNoise, ErrorsAreAsLargeAsStated) {
  const TelemetryUncertainty sigma{radians(3), 0.03, radians(0.8)};
  double heading = 0, agl = 0, pitch = 0, roll = 0;
  int count = 0;
  for (std::uint64_t seed = 0; seed < 400; ++seed) {
    TelemetryNoise noise(sigma, seed);
    for (int i = 0; i < 20; ++i, ++count) {
      const MeasuredPose measured = noise.measure(pose_at(3.0 * i));
      heading += std::pow(measured.attitude.heading_rad / sigma.heading_rad, 2);
      agl += std::pow((measured.agl_m / 250 - 1) / sigma.agl_relative, 2);
      pitch += std::pow(measured.attitude.pitch_rad / sigma.tilt_rad, 2);
      roll += std::pow(measured.attitude.roll_rad / sigma.tilt_rad, 2);
    }
  }
  for (const double sum : {heading, agl, pitch, roll}) EXPECT_NEAR(std::sqrt(sum / count), 1.0, 0.1);
}

// The same error whenever the aircraft is on that course again.
TEST(TelemetryNoise, TheCompassErrorDependsOnTheCourse) {
  const TelemetryUncertainty sigma{radians(3), 0.03, radians(0.8)};
  constexpr int kRounds = 400;
  double spread = 0;
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    TelemetryNoise noise(sigma, seed);
    std::array<double, 4> off{};  // north, east, south, west: the mean over all rounds
    for (int i = 0; i < 4 * kRounds; ++i) {
      FlightPose pose = pose_at(i);
      pose.attitude.heading_rad = radians(90) * (i % 4);
      off.at(static_cast<std::size_t>(i % 4)) +=
          (noise.measure(pose).attitude.heading_rad - pose.attitude.heading_rad) / kRounds;
    }
    EXPECT_NEAR(off[0] + off[2], off[1] + off[3], 0.3 * sigma.heading_rad) << "the constant is one and the same";
    spread += (std::pow(off[0] - off[2], 2) + std::pow(off[1] - off[3], 2)) / 2 / 40;
  }
  EXPECT_NEAR(std::sqrt(spread), 2 * 0.6 * sigma.heading_rad, 0.3 * sigma.heading_rad);
}

TEST(TelemetryNoise, OnOneCourseTheCompassKeepsItsError) {
  const TelemetryUncertainty sigma{radians(3), 0.03, radians(0.8)};
  double spread_of_means = 0;
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    TelemetryNoise noise(sigma, seed);
    double first = 0, second = 0;
    for (int i = 0; i < 100; ++i) (i < 50 ? first : second) += noise.measure(pose_at(i)).attitude.heading_rad / 50;
    EXPECT_NEAR(first, second, 0.55 * sigma.heading_rad);
    spread_of_means += first * first / 60;
  }
  EXPECT_GT(std::sqrt(spread_of_means), 0.5 * sigma.heading_rad);
}

// Dead reckoning for a minute from a known velocity: the error of the measured sum is as the camera file states.
TEST(TelemetryNoise, TheAccelerometerErrorIsAsStatedAfterAMinute) {
  const TelemetryUncertainty sigma{radians(0.01), 0.03, radians(0.8), 0.4};
  double sum = 0;
  for (std::uint64_t seed = 0; seed < 400; ++seed) {
    TelemetryNoise noise(sigma, seed);
    EXPECT_FALSE(noise.measure(pose_at(0)).imu_dv_mps) << "no previous pose";
    Eigen::Vector2d velocity = Eigen::Vector2d::Zero();
    for (int i = 1; i <= 30; ++i) velocity += *noise.measure(pose_at(2.0 * i)).imu_dv_mps;
    sum += velocity.squaredNorm() / 2;
  }
  EXPECT_NEAR(std::sqrt(sum / 400), 0.4 * std::sqrt(60), 0.15 * 0.4 * std::sqrt(60));
}

// Its east and north are those of the compass.
TEST(TelemetryNoise, TheAccelerometerIsRotatedByTheCompassError) {
  const TelemetryUncertainty sigma{radians(10), 0.03, radians(0.8), 1e-9};
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    TelemetryNoise noise(sigma, seed);
    FlightPose pose = pose_at(0);
    noise.measure(pose);
    double compass = 0;
    for (int i = 1; i <= 400; ++i) {
      pose.time_s = i;
      pose.velocity_mps = {i % 2 == 0 ? 0.0 : 30.0, 0};
      compass += noise.measure(pose).attitude.heading_rad / 400;
    }
    pose.time_s = 401;
    pose.velocity_mps = {30, 0};
    const Eigen::Vector2d measured = *noise.measure(pose).imu_dv_mps;
    EXPECT_NEAR(std::atan2(-measured.y(), measured.x()), compass, radians(1.5));
  }
}

}  // namespace
}  // namespace nadir
