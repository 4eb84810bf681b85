#include "estimation/drawn_flight.hpp"

#include <Eigen/LU>
#include <cmath>

#include "geodesy/angles.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir::test {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;
using F = FlightFilter;
namespace model = parameters::telemetry;

constexpr double kStartSigma_m = 20, kAgl_m = 200;
constexpr double kTurn_rad = 0.17;  // per second: a bank of 20 degrees

template <int Rows>
Eigen::Matrix<double, Rows, 1> normals(Random& random) {
  Eigen::Matrix<double, Rows, 1> values;
  for (double& value : values) value = random.normal();
  return values;
}

Matrix2d clockwise(double angle) {
  Matrix2d turned;
  turned << std::cos(angle), std::sin(angle), -std::sin(angle), std::cos(angle);
  return turned;
}

struct Truth : DrawnTruth {
  Truth(Random& random, const TelemetryUncertainty& sigma) : DrawnTruth(random, sigma), wind(5 * normals<2>(random)) {
    heading = random.uniform(-kPi, kPi);
    velocity = wind + 20 * Vector2d(std::sin(heading), std::cos(heading));
  }

  void fly(Random& random, const TelemetryUncertainty& sigma, double turn, double seconds) {
    constexpr int kSmall = 20;  // steps, so that the path is an arc
    for (int i = 0; i < kSmall; ++i) {
      heading += turn / kSmall;
      velocity = wind + 20 * Vector2d(std::sin(heading), std::cos(heading));
      place += velocity * seconds / kSmall;
    }
    drift(random, sigma, turn, seconds);
  }

  Vector2d wind, velocity;
};

}  // namespace

DrawnTruth::DrawnTruth(Random& random, const TelemetryUncertainty& sigma)
    : heading_bias(random.normal(0, model::kHeadingBiasShare * sigma.heading_rad)),
      log_height(random.normal(0, sigma.agl_relative)),
      tilt_bias(sigma.tilt_rad * normals<2>(random)),
      deviation(model::kDeviationShare * sigma.heading_rad * normals<2>(random)),
      place(kStartSigma_m * normals<2>(random)) {}

void DrawnTruth::drift(Random& random, const TelemetryUncertainty& sigma, double turn, double seconds) {
  log_height = std::sqrt(1 - model::kHeightInnovationShare * model::kHeightInnovationShare) * log_height +
               random.normal(0, model::kHeightInnovationShare * sigma.agl_relative);
  const double keep = std::exp(-seconds / model::kTiltTimeLogged_s);
  tilt_bias = keep * tilt_bias + std::sqrt(1 - keep * keep) * sigma.tilt_rad * normals<2>(random);
  const double kept = std::exp(-seconds / model::kDeviationTime_s);
  deviation = kept * (clockwise(turn) * deviation) +
              std::sqrt(1 - kept * kept) * model::kDeviationShare * sigma.heading_rad * normals<2>(random);
}

LinearizationPoint linearized_at(const F& filter) {
  const auto& x = filter.state();
  return {x[F::log_height], x[F::heading], x[F::pitch], x[F::roll]};
}

// Tilt is seen vaguely, and the motion is as far off as that: together they are known well.
RelativeMotionMeasurement see_motion(Random& random, const LinearizationPoint& before, const LinearizationPoint& now,
                                     const DrawnTruth& was, const DrawnTruth& is) {
  Eigen::Matrix<double, 8, 8> spread = Eigen::Matrix<double, 8, 8>::Zero();
  spread.diagonal() << 0.4, 0.4, 0.004, 0.004, 0.026, 0.026, 0.026, 0.026;
  spread.block<2, 2>(0, 4) = -0.026 * kAgl_m * Matrix2d::Identity();
  spread.block<2, 2>(0, 6) = 0.026 * kAgl_m * Matrix2d::Identity();
  RelativeMotionMeasurement measurement;
  measurement.before = before;
  measurement.now = now;
  measurement.covariance = spread * spread.transpose();
  // In the scale and directions of what was estimated of the frame before.
  measurement.value.head<2>() = std::exp(before.log_height - was.log_height) *
                                (clockwise(before.heading_rad - was.heading) * (is.place - was.place));
  measurement.value[2] = (is.log_height - was.log_height) - (now.log_height - before.log_height);
  measurement.value[3] = wrap_pi((is.heading - was.heading) - (now.heading_rad - before.heading_rad));
  measurement.value.tail<4>() << was.tilt - Vector2d(before.pitch_rad, before.roll_rad),
      is.tilt - Vector2d(now.pitch_rad, now.roll_rad);
  measurement.value += spread * normals<8>(random);
  return measurement;
}

PoseMeasurement see_place(Random& random, const DrawnTruth& truth, const Vector2d& off_m) {
  Eigen::Matrix<double, 6, 6> spread = Eigen::Matrix<double, 6, 6>::Zero();
  spread.diagonal() << 2, 2, 0.012, 0.006, 0.017, 0.017;
  spread.topRightCorner<2, 2>() = 0.017 * kAgl_m * Matrix2d::Identity();
  PoseMeasurement measurement;
  measurement.covariance = spread * spread.transpose();
  measurement.value << truth.place + off_m, truth.log_height, truth.heading, truth.tilt;
  measurement.value += spread * normals<6>(random);
  measurement.value[3] = wrap_pi(measurement.value[3]);
  return measurement;
}

double normalised_error(const Vector2d& error_m, const Matrix2d& covariance_m2) {
  return error_m.dot(covariance_m2.inverse() * error_m);
}

DrawnFlight draw_flight(Random random, const DrawnOptions& options) {
  const TelemetryUncertainty& sigma = options.uncertainty;
  Truth is(random, sigma);
  F filter(sigma, true, {0, 0}, kStartSigma_m);
  DrawnFlight flight{filter, {}, {}};
  const int round = options.blind_every + options.blind_frames;
  for (int i = 0; i < options.frames; ++i) {
    const Truth was = is;
    if (i > 0) is.fly(random, sigma, i % 40 > 31 ? kTurn_rad * options.interval_s : 0, options.interval_s);
    is.tilt = is.tilt_bias + model::kWhiteTiltShareLogged * sigma.tilt_rad * normals<2>(random);
    FlightStep step;
    step.seconds = i > 0 ? options.interval_s : 0;
    step.measured_heading_rad =
        wrap_pi(is.heading - is.heading_error() - random.normal(0, model::kWhiteHeadingShare * sigma.heading_rad));
    if (options.imu && i > 0) {
      step.imu_dv_mps = clockwise(-was.heading_error()) * (is.velocity - was.velocity) +
                        sigma.imu_dv_mps * std::sqrt(options.interval_s) * normals<2>(random);
    }
    const LinearizationPoint before = linearized_at(filter);
    filter.predict(step.seconds, step.measured_heading_rad, step.tilt_measured, step.imu_dv_mps);
    DrawnFrame frame;
    frame.blind = options.blind_every > 0 && i % round >= options.blind_every;
    const bool was_blind = options.blind_every > 0 && i > 0 && (i - 1) % round >= options.blind_every;
    if (i > 0 && !frame.blind && !was_blind) {
      step.relative_motion = see_motion(random, before, linearized_at(filter), was, is);
      filter.update_relative(*step.relative_motion);
    }
    if (!frame.blind && i % options.anchor_every == options.anchor_every / 2) {
      Vector2d off = Vector2d::Zero();
      if (random.chance(options.wrong_anchor_share)) {
        off = clockwise(random.uniform(-kPi, kPi)) * Vector2d(random.uniform(80, 400), 0);
      }
      step.anchor = see_place(random, is, off);
      const Vector2d ahead = step.anchor->value.head<2>() - filter.position().vector();
      if (off.isZero()) {
        frame.anchor_chi2 =
            normalised_error(ahead, filter.position_covariance_m2() + step.anchor->covariance.topLeftCorner<2, 2>());
      }
      filter.update_absolute(*step.anchor);
    }
    frame.truth_m = is.place;
    frame.online_m = filter.position().vector();
    frame.velocity_mps = filter.state().segment<2>(F::velocity_east);
    frame.covariance_m2 = filter.position_covariance_m2();
    frame.nees = normalised_error(frame.online_m - frame.truth_m, frame.covariance_m2);
    flight.steps.push_back(step);
    flight.frames.push_back(frame);
  }
  return flight;
}

}  // namespace nadir::test
