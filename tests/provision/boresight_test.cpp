// The mount from frames whose truth the test makes itself: an aircraft flies legs, its camera's attitude is composed by
// rotation matrices (not by the code under test), GPS and telemetry err as stated.
#include "provision/boresight.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <random>

#include "geodesy/angles.hpp"

namespace nadir {
namespace {

// Yaw, pitch and roll of the product of two attitudes, from north-east-down rotations.
Attitude composed(const Attitude& aircraft, const Attitude& mount) {
  const auto ned = [](const Attitude& a) -> Eigen::Matrix3d {
    return (Eigen::AngleAxisd(a.heading_rad, Eigen::Vector3d::UnitZ()) *
            Eigen::AngleAxisd(a.pitch_rad, Eigen::Vector3d::UnitY()) *
            Eigen::AngleAxisd(a.roll_rad, Eigen::Vector3d::UnitX()))
        .toRotationMatrix();
  };
  const Eigen::Matrix3d r = ned(aircraft) * ned(mount);
  return {std::atan2(r(1, 0), r(0, 0)), -std::asin(r(2, 0)), std::atan2(r(2, 1), r(2, 2))};
}

struct World {
  Attitude mount{radians(92), radians(-3), radians(1.5)};
  double delay_s = 0;
  Eigen::Vector2d offset_m{1.5, -2};
  double height_factor = 1.02;
  int legs = 6;             // each 60° on
  double noise = 1;         // of the stated sigmas
  double speed_change = 0;  // of 20 m/s, from leg to leg
};

constexpr double kGpsSigma_m = 0.5;

std::vector<BoresightMeasurement> flown(const World& world, unsigned seed = 3) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  const auto err = [&](double sigma) { return world.noise * sigma * normal(random); };
  std::vector<BoresightMeasurement> measurements;
  Eigen::Vector2d at(0, 0);
  for (int i = 0; i < 240; ++i) {
    const int leg = i * world.legs / 240;
    const double heading = radians(60.0 * leg + 3 * std::sin(0.7 * i));
    const double speed = 20 * (1 + world.speed_change * (leg % 2 == 0 ? 1 : -1));
    BoresightMeasurement measurement;
    measurement.time_s = i * 2.5;
    measurement.velocity_mps = speed * Eigen::Vector2d(std::sin(heading), std::cos(heading));
    at += 2.5 * measurement.velocity_mps;
    const Attitude truth{heading, radians(2 * std::sin(0.4 * i)), radians(5 * std::sin(0.3 * i))};
    const Attitude rate{radians(2.1 * std::cos(0.7 * i) / 2.5), radians(0.8 * std::cos(0.4 * i) / 2.5),
                        radians(1.5 * std::cos(0.3 * i) / 2.5)};
    measurement.aircraft = {truth.heading_rad + err(0.01), truth.pitch_rad + err(0.004), truth.roll_rad + err(0.004)};
    measurement.rate_rad_s = rate;
    measurement.gps_position = PlanePoint(at + Eigen::Vector2d(err(kGpsSigma_m), err(kGpsSigma_m)));
    // The exposure was earlier than stated.
    const double late = world.delay_s;
    const Attitude then{truth.heading_rad - late * rate.heading_rad, truth.pitch_rad - late * rate.pitch_rad,
                        truth.roll_rad - late * rate.roll_rad};
    const Attitude camera = composed(then, world.mount);
    const Eigen::Vector2d where = at - late * measurement.velocity_mps + world.offset_m;
    measurement.covariance.setZero();
    measurement.covariance.diagonal() << 0.3, 0.3, 1e-4, 1e-5, 1e-4, 1e-4;
    // Looking down, a tilt looks like a motion: what a picture of flat ground says is one of them given the other.
    measurement.covariance(0, 5) = measurement.covariance(5, 0) = 0.004;
    measurement.seen << where.x() + err(0.5), where.y() + err(0.5), std::log(world.height_factor) + err(0.01),
        wrap_pi(camera.heading_rad + err(0.003)), camera.pitch_rad + err(0.01), camera.roll_rad + err(0.01);
    measurements.push_back(measurement);
  }
  return measurements;
}

BoresightSettings settings(const Attitude& begin = {radians(90), 0, 0}) {
  BoresightSettings settings;
  settings.mount = begin;
  settings.uncertainty = {.heading_rad = 0.01, .agl_relative = 0.03, .tilt_rad = 0.004};
  settings.gps_sigma_m = kGpsSigma_m;
  return settings;
}

void expect_mount(const Boresight& found, const Attitude& truth, double sigmas) {
  const auto near = [&](double value, double wanted, double sigma, const char* what) {
    EXPECT_LE(std::abs(wrap_pi(value - wanted)), sigmas * sigma + 1e-9)
        << what << " " << degrees(value) << " instead of " << degrees(wanted) << ", sigma " << degrees(sigma);
  };
  near(found.mount.heading_rad, truth.heading_rad, found.mount_sigma.heading_rad, "yaw");
  near(found.mount.pitch_rad, truth.pitch_rad, found.mount_sigma.pitch_rad, "pitch");
  near(found.mount.roll_rad, truth.roll_rad, found.mount_sigma.roll_rad, "roll");
}

TEST(Boresight, ExactFramesGiveTheExactMount) {
  World world;
  world.noise = 0;
  const auto found = solve_boresight(flown(world), settings());
  ASSERT_TRUE(found);
  EXPECT_EQ(found->used, 240U);
  EXPECT_NEAR(degrees(found->mount.heading_rad), 92, 0.02);
  EXPECT_NEAR(degrees(found->mount.pitch_rad), -3, 0.05);
  EXPECT_NEAR(degrees(found->mount.roll_rad), 1.5, 0.05);
  EXPECT_NEAR(found->height_factor, 1.02, 0.005);
  EXPECT_NEAR(found->offset_m.x(), 1.5, 0.3);
  EXPECT_NEAR(found->offset_m.y(), -2, 0.3);
}

TEST(Boresight, SigmasAreConsistentWithTheErrors) {
  for (unsigned seed = 1; seed <= 10; ++seed) {
    const auto found = solve_boresight(flown({}, seed), settings());
    ASSERT_TRUE(found);
    expect_mount(*found, World().mount, 3);
    EXPECT_FALSE(check_boresight(found, {}).has_errors());
    EXPECT_LT(degrees(found->mount_sigma.pitch_rad), 0.5);
    EXPECT_LT(degrees(found->mount_sigma.heading_rad), 1.0);
    EXPECT_LT(found->misfit, 1.5);
  }
}

TEST(Boresight, RejectsWrongAnchors) {
  auto measurements = flown({});
  for (std::size_t i = 0; i < measurements.size(); i += 6)
    measurements[i].seen[0] += 40 + static_cast<double>(i % 7) * 5;
  const auto found = solve_boresight(measurements, settings());
  ASSERT_TRUE(found);
  EXPECT_EQ(found->outliers, 40U);
  expect_mount(*found, World().mount, 3);
}

TEST(Boresight, EstimatesTheDelayOnlyWhenSpeedsDiffer) {
  World world;
  world.delay_s = 0.3;
  world.speed_change = 0.4;
  world.noise = 0.3;
  BoresightSettings precise = settings();
  precise.gps_sigma_m = 0.1;
  const auto found = solve_boresight(flown(world), precise);
  ASSERT_TRUE(found);
  ASSERT_TRUE(found->delay_observable) << found->delay_sigma_s;
  EXPECT_NEAR(found->delay_s, 0.3, 3 * found->delay_sigma_s);
  expect_mount(*found, world.mount, 3);

  World steady;
  auto blind = flown(steady);
  for (BoresightMeasurement& measurement : blind) measurement.rate_rad_s = {}, measurement.velocity_mps.setZero();
  const auto unseen = solve_boresight(blind, settings());
  ASSERT_TRUE(unseen);
  EXPECT_FALSE(unseen->delay_observable);
  EXPECT_EQ(unseen->delay_s, 0);
}

// Of flat ground far below: a tilt and a step to the side look the same, and only GPS tells them apart.
std::vector<BoresightMeasurement> flat(std::vector<BoresightMeasurement> measurements) {
  constexpr double kHeight_m = 100, kTiltUnknown_rad2 = 0.25;
  for (BoresightMeasurement& measurement : measurements) {
    const double heading = measurement.seen[3];
    Eigen::Matrix<double, 6, 1> nodding, rolling;
    nodding << -kHeight_m * std::sin(heading), -kHeight_m * std::cos(heading), 0, 0, 1, 0;
    rolling << kHeight_m * std::cos(heading), -kHeight_m * std::sin(heading), 0, 0, 0, 1;
    measurement.covariance.setZero();
    measurement.covariance.diagonal() << 0.3, 0.3, 1e-4, 1e-5, 1e-7, 1e-7;
    measurement.covariance += kTiltUnknown_rad2 * (nodding * nodding.transpose() + rolling * rolling.transpose());
  }
  return measurements;
}

TEST(Boresight, OneLegDoesNotSeparateTheMountFromAGpsOffset) {
  World straight, turning;
  straight.legs = 1;
  const auto unsure = solve_boresight(flat(flown(straight)), settings());
  const auto sure = solve_boresight(flat(flown(turning)), settings());
  ASSERT_TRUE(unsure && sure);
  EXPECT_GT(unsure->mount_sigma.pitch_rad, 2 * sure->mount_sigma.pitch_rad);
  EXPECT_TRUE(check_boresight(unsure, {}).contains("provision.boresight_unsure"));
  EXPECT_FALSE(check_boresight(sure, {}).has_errors());
}

TEST(Boresight, AnUndeterminedMountIsAFinding) {
  EXPECT_TRUE(check_boresight(std::nullopt, {}).contains("provision.few_anchors"));
  EXPECT_FALSE(solve_boresight({}, settings()));
  auto few = flown({});
  few.resize(12);
  EXPECT_TRUE(check_boresight(solve_boresight(few, settings()), {}).contains("provision.few_anchors"));

  Boresight result;
  result.used = 100;
  EXPECT_TRUE(check_boresight(result, {}).empty());
  result.mount_sigma.pitch_rad = radians(1.1);
  EXPECT_TRUE(check_boresight(result, {}).contains("provision.boresight_unsure"));
  result.mount_sigma = {radians(3.1), 0, 0};
  EXPECT_TRUE(check_boresight(result, {}).contains("provision.boresight_unsure"));
  result.mount_sigma = {};
  result.misfit = 5;
  EXPECT_TRUE(check_boresight(result, {}).contains("provision.boresight_misfit"));
  result.misfit = 1;
  result.mount.roll_rad = radians(60);
  EXPECT_TRUE(check_boresight(result, {}).contains("provision.boresight_range"));
}

TEST(Boresight, RecoversTheAttitudeOfTheAircraft) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> any(-1, 1);
  for (int i = 0; i < 100; ++i) {
    const Attitude aircraft{3 * any(random), 0.5 * any(random), 0.7 * any(random)};
    const Attitude mount{3 * any(random), 0.5 * any(random), 0.5 * any(random)};
    const Attitude camera = camera_attitude(aircraft, mount);
    const Attitude oracle = composed(aircraft, mount);
    EXPECT_NEAR(wrap_pi(camera.heading_rad - oracle.heading_rad), 0, 1e-9);
    const Attitude back = aircraft_attitude(camera, mount);
    EXPECT_NEAR(wrap_pi(back.heading_rad - aircraft.heading_rad), 0, 1e-9);
    EXPECT_NEAR(back.pitch_rad, aircraft.pitch_rad, 1e-9);
    EXPECT_NEAR(back.roll_rad, aircraft.roll_rad, 1e-9);
  }
}

}  // namespace
}  // namespace nadir
