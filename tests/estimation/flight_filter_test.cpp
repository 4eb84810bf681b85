#include "estimation/flight_filter.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <cmath>

#include "base/random.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;
using Vector6d = Eigen::Matrix<double, 6, 1>;
using F = FlightFilter;

constexpr std::nullopt_t kNoHeading = std::nullopt;

TelemetryUncertainty filter_sensors() {
  TelemetryUncertainty uncertainty;
  uncertainty.heading_rad = radians(3);
  uncertainty.tilt_rad = radians(5);
  uncertainty.agl_relative = 0.05;
  return uncertainty;
}

// An anchor at a place, with (sigma of) position m, log height, heading, tilt.
PoseMeasurement anchor(const Vector2d& at, double heading_rad, const Vector2d& tilt_rad, const Vector6d& sigma) {
  PoseMeasurement measurement;
  measurement.value << at, 0, heading_rad, tilt_rad;
  measurement.covariance = sigma.cwiseProduct(sigma).asDiagonal();
  return measurement;
}

Vector6d vague_but(int index, double sigma) {
  Vector6d sigmas;
  sigmas << 1e5, 1e5, 1e3, 1e3, 1e3, 1e3;
  sigmas[index] = sigma;
  return sigmas;
}

PoseMeasurement place_only(const Vector2d& at, double sigma_m) {
  Vector6d sigma = vague_but(0, sigma_m);
  sigma[1] = sigma_m;
  return anchor(at, 0, Vector2d::Zero(), sigma);
}

LinearizationPoint estimated(const F& filter) {
  const auto& x = filter.state();
  return {x[F::log_height], x[F::heading], x[F::pitch], x[F::roll]};
}

// Odometry that measures this motion, and no change of attitude and height from their estimates.
RelativeMotionMeasurement step_of(const F& filter, const LinearizationPoint& before, const Vector2d& moved,
                                  double sigma_m, double turn_sigma_rad = 0.001, double height_sigma = 0.001) {
  RelativeMotionMeasurement measurement;
  measurement.before = before;
  measurement.now = estimated(filter);
  measurement.value.setZero();
  measurement.value.head<2>() = moved;
  Eigen::Matrix<double, 8, 1> sigma;
  sigma << sigma_m, sigma_m, height_sigma, turn_sigma_rad, 100, 100, 100, 100;
  measurement.covariance = sigma.cwiseProduct(sigma).asDiagonal();
  return measurement;
}

void fly(F& filter, int frames, const Vector2d& step, double sigma_m, double heading_rad = 0) {
  for (int i = 0; i < frames; ++i) {
    const LinearizationPoint before = estimated(filter);
    filter.predict(1, heading_rad);
    filter.update_relative(step_of(filter, before, step, sigma_m));
  }
}

double smallest_growth(const Matrix2d& before, const Matrix2d& after) {
  return Eigen::SelfAdjointEigenSolver<Matrix2d>(after - before).eigenvalues()[0];
}

double off_deg(double a_rad, double b_rad) { return std::abs(degrees(wrap_pi(a_rad - b_rad))); }

TEST(FlightFilter, WithoutMeasurementsUncertaintyOnlyGrows) {
  F filter(filter_sensors(), true, {3, 4}, 10);
  filter.predict(0, radians(20));
  fly(filter, 3, {20, 5}, 0.3, radians(20));
  filter.update_absolute(place_only({63, 19}, 1));
  for (int i = 0; i < 400; ++i) {
    const Matrix2d before = filter.position_covariance_m2();
    filter.predict(i % 3 == 0 ? 0.1 : 2.0, i % 2 == 0 ? std::optional(radians(20 + i)) : kNoHeading);
    ASSERT_GE(smallest_growth(before, filter.position_covariance_m2()), -1e-9 * before.norm()) << i;
  }
  EXPECT_TRUE(filter.covariance().allFinite());
  EXPECT_LT(filter.sigma(F::velocity_east), 40) << "no aircraft becomes arbitrarily fast";
}

// Frames with the same time stamp were not taken at the same time: the clock has stopped.
TEST(FlightFilter, AStoppedClockMovesNothingButInflatesThePosition) {
  F filter(filter_sensors(), true, {3, 4}, 10);
  filter.predict(0, radians(20));
  fly(filter, 3, {20, 5}, 0.3, radians(20));
  const Matrix2d before = filter.position_covariance_m2();
  const Vector2d at = filter.position().vector();
  filter.predict(0, radians(20));
  EXPECT_LT((filter.position().vector() - at).norm(), 1e-9);
  EXPECT_NEAR(std::sqrt(filter.position_covariance_m2()(0, 0) - before(0, 0)), std::hypot(20, 5), 1.5);
  filter.predict(-5, kNoHeading);
  EXPECT_LT((filter.position().vector() - at).norm(), 1e-9);
  EXPECT_TRUE(filter.covariance().allFinite());
}

TEST(FlightFilter, TiltThatIsNoLongerMeasuredIsUncertain) {
  F filter(filter_sensors(), true, {0, 0}, 10);
  filter.predict(0, radians(20), true);
  const double measured = filter.sigma(F::roll);
  filter.predict(1, radians(20), false);
  EXPECT_GT(filter.sigma(F::roll), radians(20));
  EXPECT_GT(filter.white_tilt_sigma_rad(), radians(20));
  filter.predict(1, radians(20), true);
  EXPECT_NEAR(filter.sigma(F::roll), measured, 1e-3);
}

TEST(FlightFilter, PropagatesWithItsVelocityWhichTurnsWithTheAircraft) {
  F straight(filter_sensors(), true, {0, 0}, 1);
  straight.predict(0, radians(90));
  fly(straight, 5, {20, 0}, 0.3, radians(90));
  F turning = straight;
  straight.predict(3, radians(90));
  EXPECT_LT((straight.position() - PlanePoint(160, 0)).norm(), 2);
  for (int i = 1; i <= 18; ++i) turning.predict(1, radians(90 + 10 * i));  // half a circle to the right
  EXPECT_GT(turning.position().east_m, 60);
  EXPECT_LT(turning.position().east_m, 140) << "back abeam of where the turn began";
  EXPECT_NEAR(turning.position().north_m, -2 * 20 / radians(10), 15) << "a diameter to the south";
}

// What all steps share grows with the distance.
TEST(FlightFilter, HeadingErrorsActAcrossAndHeightErrorsAlong) {
  const auto after = [](int frames, double heading_deg, double agl_relative) {
    TelemetryUncertainty uncertainty = filter_sensors();
    uncertainty.heading_rad = radians(heading_deg);
    uncertainty.agl_relative = agl_relative;
    F filter(uncertainty, true, {0, 0}, 0.01);
    filter.predict(0, radians(90));
    fly(filter, frames, {30, 0}, 0.01, radians(90));
    return filter.position_covariance_m2();
  };
  const double heading = std::hypot(radians(2), radians(1) / std::sqrt(15));  // bias, and noise that averages out
  EXPECT_NEAR(std::sqrt(after(10, 2, 0.0001)(1, 1)), 300 * heading, 0.15 * 300 * heading);
  EXPECT_NEAR(std::sqrt(after(40, 2, 0.0001)(1, 1)), 1200 * heading, 0.15 * 1200 * heading);
  EXPECT_GT(std::sqrt(after(10, 0.01, 0.03)(0, 0)), 0.7 * 300 * 0.03);
  EXPECT_LT(std::sqrt(after(10, 0.01, 0.03)(0, 0)), 1.1 * 300 * 0.03);
  EXPECT_LT(std::sqrt(after(10, 0.01, 0.03)(1, 1)), 0.5) << "not across";
}

TEST(FlightFilter, TwoMeasurementsOfAPositionAreFusedAsInTextbooks) {
  F filter(filter_sensors(), true, {300, 0}, 20);
  filter.predict(0, kNoHeading);
  const Matrix2d before = filter.position_covariance_m2();
  Matrix2d measured;
  measured << 4, 1, 1, 9;
  PoseMeasurement measurement = place_only({310, 5}, 1);
  measurement.covariance.topLeftCorner<2, 2>() = measured;
  filter.update_absolute(measurement);
  const Matrix2d expected = (before.inverse() + measured.inverse()).inverse();
  EXPECT_LT((filter.position_covariance_m2() - expected).norm(), 1e-6);
  const Vector2d position = expected * (before.inverse() * Vector2d(300, 0) + measured.inverse() * Vector2d(310, 5));
  EXPECT_LT((filter.position().vector() - position).norm(), 1e-6);
}

TEST(FlightFilter, UnknownHeadingIsUncertainUntilAnAnchorMeasuresIt) {
  F filter(filter_sensors(), true, {0, 0}, 5);
  filter.predict(0, kNoHeading);
  EXPECT_GT(filter.sigma(F::heading), radians(90));
  filter.update_absolute(anchor({0, 0}, radians(-100), {0, 0}, vague_but(3, radians(1))));
  EXPECT_LT(off_deg(filter.state()[F::heading], radians(-100)), 0.1);
  EXPECT_LT(filter.sigma(F::heading), radians(1.1));
}

// An inflated heading makes each step uncertain across the track, until an anchor measures the heading again.
TEST(FlightFilter, AnInflatedHeadingMakesTheCourseUncertain) {
  F filter(filter_sensors(), true, {0, 0}, 5);
  fly(filter, 5, {0, 20}, 0.2);
  const double before_m = filter.position_sigma_m();
  filter.inflate_heading(radians(170));
  EXPECT_GT(filter.sigma(F::heading), radians(100));
  fly(filter, 5, {0, 20}, 0.2);
  EXPECT_GT(std::sqrt(filter.position_covariance_m2()(0, 0)), 100) << "100 m flown in an unknown direction";
  EXPECT_LT(std::sqrt(filter.position_covariance_m2()(1, 1)), 2 * before_m) << "linear: small along the track";
  EXPECT_GT(filter.sigma(F::heading), radians(60)) << "the telemetry's next headings are no better";
  filter.update_absolute(anchor({0, 0}, radians(100), {0, 0}, vague_but(3, radians(1))));
  filter.predict(1, 0);
  EXPECT_LT(off_deg(filter.state()[F::heading], radians(100)), 5);
  EXPECT_LT(filter.sigma(F::heading), radians(4));
}

// A compass that is off by a constant and by a deviation. What anchors show on one course, and on the others later.
struct Compass {
  double constant_rad, sine_rad, cosine_rad;

  double measured_rad(double truth_rad) const {
    return wrap_pi(truth_rad - constant_rad - sine_rad * std::sin(truth_rad) - cosine_rad * std::cos(truth_rad));
  }
};

// So many frames, a second apart, turning by so much in each; an anchor measures the heading in every third.
void fly_anchored(F& filter, Random& random, const Compass& compass, double& truth_rad, int frames, double turn_rad) {
  for (int i = 0; i < frames; ++i) {
    truth_rad += turn_rad;
    filter.predict(1, wrap_pi(compass.measured_rad(truth_rad) + random.normal(0, radians(0.5))));
    const double seen_rad = wrap_pi(truth_rad + random.normal(0, radians(0.6)));
    if (i % 3 == 0) filter.update_absolute(anchor({0, 0}, seen_rad, {0, 0}, vague_but(3, radians(0.6))));
  }
}

TEST(FlightFilter, ACircleRevealsTheDeviationOnEveryCourse) {
  for (const Compass compass : {Compass{radians(5), 0, 0}, Compass{radians(-2), radians(3), radians(-3)}}) {
    Random random(1);
    F filter(filter_sensors(), true, {0, 0}, 5);
    double truth_rad = radians(30);
    fly_anchored(filter, random, compass, truth_rad, 72, radians(10));
    for (const double course_deg : {-120, -77, 10, 100}) {
      F later = filter;
      later.predict(1, compass.measured_rad(radians(course_deg)));
      EXPECT_LT(off_deg(later.state()[F::heading], radians(course_deg)), 1.5) << course_deg;
      EXPECT_LT(later.sigma(F::heading), radians(2)) << course_deg;
    }
  }
}

// An estimate from a long leg determines little on the course after a turn, where an autopilot's heading may be off by
// degrees.
TEST(FlightFilter, AfterATurnTheCompassIsUncertain) {
  Random random(2);
  F filter(filter_sensors(), true, {0, 0}, 5);
  const Compass compass{radians(2), 0, radians(4)};
  double truth_rad = 0;
  fly_anchored(filter, random, compass, truth_rad, 90, 0);
  EXPECT_LT(filter.sigma(F::heading), radians(2)) << "hardly more than what changes from frame to frame";
  F straight = filter, turned = filter;
  straight.predict(1, compass.measured_rad(0));
  EXPECT_LT(off_deg(straight.state()[F::heading], 0), 1);
  turned.predict(1, compass.measured_rad(kPi));
  EXPECT_GT(off_deg(turned.state()[F::heading], kPi), 2) << "it is unobservable";
  EXPECT_LT(off_deg(turned.state()[F::heading], kPi), 3 * degrees(turned.sigma(F::heading)));
  EXPECT_GT(turned.sigma(F::heading), 1.5 * straight.sigma(F::heading));
}

// Images measure a turn to a tenth of a degree. Any difference of the compass is its own error.
TEST(FlightFilter, InATurnImagesOutweighTheCompass) {
  Random random(3);
  F filter(filter_sensors(), true, {0, 0}, 5);
  const Compass compass{0, 0, radians(5)};
  double truth_rad = 0;
  fly_anchored(filter, random, compass, truth_rad, 60, 0);
  for (int i = 0; i < 18; ++i) {
    const LinearizationPoint before = estimated(filter);
    const double was_rad = truth_rad;
    truth_rad += radians(10);
    filter.predict(1, wrap_pi(compass.measured_rad(truth_rad) + random.normal(0, radians(0.5))));
    RelativeMotionMeasurement measurement =
        step_of(filter, before, 20 * Vector2d(std::sin(was_rad), std::cos(was_rad)), 0.2, radians(0.3));
    measurement.value[3] = wrap_pi((truth_rad - was_rad) - (measurement.now.heading_rad - before.heading_rad)) +
                           random.normal(0, radians(0.3));
    filter.update_relative(measurement);
  }
  const double off = off_deg(filter.state()[F::heading], truth_rad);
  EXPECT_LT(off, 3) << "the compass shows a turn that is 10 degrees too small";
  EXPECT_LT(off, 3 * degrees(filter.sigma(F::heading)));
}

// A circle flown twice, its headings in (−180°, 180°]: no jump where the telemetry jumps.
TEST(FlightFilter, CrossesSouthWithoutAJump) {
  F filter(filter_sensors(), true, {0, 0}, 5);
  double truth = radians(150);
  for (int i = 0; i < 72; ++i) {
    truth += radians(10);
    filter.predict(1, wrap_pi(truth));
    if (i % 5 == 0) filter.update_absolute(anchor({0, 0}, wrap_pi(truth), {0, 0}, vague_but(3, radians(0.5))));
    ASSERT_LT(off_deg(filter.state()[F::heading], truth), 0.01) << i;
    ASSERT_LT(off_deg(filter.state()[F::heading_bias] + filter.state()[F::deviation], 0), 0.01) << i;
  }
}

TEST(FlightFilter, EstimatesTheBoresight) {
  Random random(2);
  F filter(filter_sensors(), true, {0, 0}, 5);
  for (int i = 0; i < 80; ++i) {
    filter.predict(0.1, kNoHeading);
    const double n = radians(0.8);
    PoseMeasurement measurement =
        anchor({0, 0}, 0, {radians(6) + random.normal(0, radians(3.5)), radians(-2) + random.normal(0, radians(3.5))},
               vague_but(4, n));
    measurement.covariance(5, 5) = n * n;
    filter.update_absolute(measurement);
  }
  EXPECT_NEAR(degrees(filter.state()[F::pitch_bias]), 6, 1.2);
  EXPECT_NEAR(degrees(filter.state()[F::roll_bias]), -2, 1.2);
  EXPECT_LT(filter.sigma(F::pitch_bias), radians(1));
}

// A bare airframe without logged attitude has a new tilt in every frame; a gimbal does not. The frames show which it
// is.
TEST(FlightFilter, EstimatesTheTiltScatterWhenTiltIsNotLogged) {
  const auto learnt_deg = [](double wobble_rad) {
    Random random(3);
    F filter(filter_sensors(), false, {0, 0}, 5);
    for (int i = 0; i < 200; ++i) {
      const double n = radians(0.3);
      filter.predict(1, kNoHeading);
      const auto wobble = [&] { return random.normal(0, std::hypot(wobble_rad, n)); };
      PoseMeasurement measurement = anchor({0, 0}, 0, {radians(3) + wobble(), wobble()}, vague_but(4, n));
      measurement.covariance(5, 5) = n * n;
      filter.update_absolute(measurement);
    }
    return degrees(filter.white_tilt_sigma_rad());
  };
  EXPECT_NEAR(learnt_deg(radians(4)), 4, 0.8);
  EXPECT_LT(learnt_deg(radians(0.05)), 0.5);
}

TEST(FlightFilter, VagueMeasurementsDoNotChangeTheTiltScatter) {
  F filter(filter_sensors(), false, {0, 0}, 5);
  filter.predict(0, radians(10));
  const F before = filter;
  for (int i = 0; i < 50; ++i) filter.update_absolute(anchor({900, 0}, 2, {1, -1}, vague_but(0, 1e5)));
  EXPECT_LT((filter.position() - before.position()).norm(), 0.5);
  EXPECT_LT(std::abs(filter.state()[F::pitch]), radians(0.3));
  EXPECT_DOUBLE_EQ(filter.white_tilt_sigma_rad(), before.white_tilt_sigma_rad());
}

// ---- A measurement that may be none

struct Moved {
  F::State by;
  F::Covariance narrowed;
};

// What an anchor does to a filter whose position is known to 5 m, when it is a chance peak with this chance.
Moved moved_by_anchor(double doubt, double anchor_sigma_m = 4) {
  F filter(filter_sensors(), true, {0, 0}, 5);
  Vector6d sigma;
  sigma << anchor_sigma_m, anchor_sigma_m, 0.02, 0.02, 0.03, 0.03;
  PoseMeasurement measurement = anchor({6, -3}, 0.02, {0.01, 0.02}, sigma);
  measurement.covariance = weighted_by_association(measurement.covariance, doubt, filter.pose_covariance());
  const F before = filter;
  filter.update_absolute(measurement);
  return {filter.state() - before.state(), before.covariance() - filter.covariance()};
}

TEST(Association, ASureMeasurementIsTakenAsItIs) {
  const Eigen::Matrix2d measured = Eigen::Vector2d(4, 9).asDiagonal(), predicted = Eigen::Matrix2d::Identity() * 7;
  EXPECT_EQ(weighted_by_association(measured, 0, predicted), measured);
}

// The filter's position is 5 m wide, the anchor 4 m: within kWidestPrior.
TEST(Association, TheGainIsThatOfASureOneByWhatIsSure) {
  const Moved sure = moved_by_anchor(0), weighted = moved_by_anchor(0.2);
  // Not quite: part of the prediction is left out as too wide for this measurement (25 m² beside 160 m²).
  EXPECT_GT(weighted.by[F::east], 0.8 * sure.by[F::east]);
  EXPECT_LT(weighted.by[F::east], 0.83 * sure.by[F::east]);
  EXPECT_LT(weighted.by[F::north], 0.8 * sure.by[F::north]);
  EXPECT_GT(weighted.by[F::north], 0.83 * sure.by[F::north]);
  EXPECT_NEAR(weighted.narrowed(F::east, F::east), 0.81 * sure.narrowed(F::east, F::east), 0.03 * 25);
}

TEST(Association, MoreDoubtMovesTheFilterLess) {
  double last = moved_by_anchor(0).by[F::east];
  for (const double doubt : {0.05, 0.2, 0.5, 0.9, 0.999}) {
    const double now = moved_by_anchor(doubt).by[F::east];
    EXPECT_LT(now, last);
    EXPECT_GT(now, 0);
    last = now;
  }
  EXPECT_LT(last, 0.05);
}

// A start that may be anywhere within kilometres says nothing of how far beside the truth a chance peak lies.
TEST(Association, OfAVaguePredictionOnlyWhatIsAroundTheMeasurementCounts) {
  const Eigen::Matrix2d measured = Eigen::Matrix2d::Identity() * 16, predicted = Eigen::Matrix2d::Identity() * 1e8;
  const double variance_m2 = weighted_by_association(measured, 0.1, predicted)(0, 0);
  EXPECT_NEAR(variance_m2, 16 * (1 + 0.1 * parameters::pose_measurement::kWidestPrior) / 0.9, 1e-3);
}

}  // namespace
}  // namespace nadir
