#include "batch_graph.hpp"

#include <ceres/ceres.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <ctime>

#include "geodesy/angles.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir::bench {
namespace {

namespace model = parameters::telemetry;

// Of a frame: position and velocity east, north; log height; heading, pitch, roll; constant parts of pitch and roll;
// the compass' deviation on this course and abeam.
constexpr int kEast = 0, kVelocity = 2, kHeight = 4, kHeading = 5, kTilt = 6, kTiltBias = 8, kDeviation = 10,
              kStates = 12;
using State = Eigen::Matrix<double, kStates, 1>;
template <typename T>
using Vec2 = Eigen::Matrix<T, 2, 1>;

template <typename T>
T wrapped(const T& angle) {
  return angle - T(2 * kPi) * ceres::floor((angle + T(kPi)) / T(2 * kPi));
}

template <typename T>
Vec2<T> clockwise(const T& angle, const Vec2<T>& v) {
  using std::cos, std::sin;
  return {cos(angle) * v.x() + sin(angle) * v.y(), -sin(angle) * v.x() + cos(angle) * v.y()};
}

// What each frame's telemetry says: heading, tilt.
struct HeadingResidual {
  double heading, heading_sigma, changing_tilt;
  template <typename T>
  bool operator()(const T* x, const T* heading_bias, T* r) const {
    r[0] = wrapped(x[kHeading] - T(heading) - heading_bias[0] - x[kDeviation]) / T(heading_sigma);
    r[1] = (x[kTilt] - x[kTiltBias]) / T(changing_tilt);
    r[2] = (x[kTilt + 1] - x[kTiltBias + 1]) / T(changing_tilt);
    return true;
  }
};

// From frame to frame: velocity that turns with the aircraft, heights, constant tilts and Gauss-Markov deviations.
struct Carry {
  double dt, height_keep, height_sigma, bias_keep, bias_sigma, measured_turn, deviation_keep, deviation_sigma;
  Eigen::Matrix4d whiten;
  template <typename T>
  bool operator()(const T* a, const T* b, T* r) const {
    const Vec2<T> va(a[kVelocity], a[kVelocity + 1]), vb(b[kVelocity], b[kVelocity + 1]);
    const Vec2<T> predicted = clockwise(wrapped(b[kHeading] - a[kHeading]), va);
    Eigen::Matrix<T, 4, 1> off;
    off << b[0] - a[0] - T(dt / 2) * (va.x() + predicted.x()), b[1] - a[1] - T(dt / 2) * (va.y() + predicted.y()),
        vb - predicted;
    Eigen::Map<Eigen::Matrix<T, 4, 1>>(r, 4) = whiten.cast<T>() * off;
    r[4] = (b[kHeight] - T(height_keep) * a[kHeight]) / T(height_sigma);
    for (int i = 0; i < 2; ++i) r[5 + i] = (b[kTiltBias + i] - T(bias_keep) * a[kTiltBias + i]) / T(bias_sigma);
    const Vec2<T> deviation =
        T(deviation_keep) * clockwise(T(measured_turn), Vec2<T>(a[kDeviation], a[kDeviation + 1]));
    for (int i = 0; i < 2; ++i) r[7 + i] = (b[kDeviation + i] - deviation[i]) / T(deviation_sigma);
    return true;
  }
};

struct Begin {
  State mean, sigma;
  template <typename T>
  bool operator()(const T* x, T* r) const {
    constexpr int kOf[] = {0, 1, 2, 3, kHeight, kTiltBias, kTiltBias + 1, kDeviation, kDeviation + 1};
    for (int i = 0; i < 9; ++i) r[i] = (x[kOf[i]] - T(mean[kOf[i]])) / T(sigma[kOf[i]]);
    return true;
  }
};

struct Bias {
  double sigma;
  template <typename T>
  bool operator()(const T* bias, T* r) const {
    r[0] = bias[0] / T(sigma);
    return true;
  }
};

struct Moved {
  RelativeMotionMeasurement measurement;
  Eigen::Matrix<double, 8, 8> whiten;
  template <typename T>
  bool operator()(const T* a, const T* b, T* r) const {
    using std::exp;
    const Vec2<T> seen(T(measurement.value[0]), T(measurement.value[1]));
    const Vec2<T> step = exp(a[kHeight] - T(measurement.before.log_height)) *
                         clockwise(a[kHeading] - T(measurement.before.heading_rad), seen);
    Eigen::Matrix<T, 8, 1> off;
    off << b[0] - a[0] - step.x(), b[1] - a[1] - step.y(),
        (b[kHeight] - a[kHeight]) - T(measurement.now.log_height - measurement.before.log_height) -
            T(measurement.value[2]),
        wrapped((b[kHeading] - a[kHeading]) - T(measurement.now.heading_rad - measurement.before.heading_rad) -
                T(measurement.value[3])),
        a[kTilt] - T(measurement.before.pitch_rad + measurement.value[4]),
        a[kTilt + 1] - T(measurement.before.roll_rad + measurement.value[5]),
        b[kTilt] - T(measurement.now.pitch_rad + measurement.value[6]),
        b[kTilt + 1] - T(measurement.now.roll_rad + measurement.value[7]);
    Eigen::Map<Eigen::Matrix<T, 8, 1>>(r, 8) = whiten.cast<T>() * off;
    return true;
  }
};

struct Anchored {
  PoseMeasurement measurement;
  Eigen::Matrix<double, 6, 6> whiten;
  template <typename T>
  bool operator()(const T* x, T* r) const {
    Eigen::Matrix<T, 6, 1> off;
    off << x[0] - T(measurement.value[0]), x[1] - T(measurement.value[1]), x[kHeight] - T(measurement.value[2]),
        wrapped(x[kHeading] - T(measurement.value[3])), x[kTilt] - T(measurement.value[4]),
        x[kTilt + 1] - T(measurement.value[5]);
    Eigen::Map<Eigen::Matrix<T, 6, 1>>(r, 6) = whiten.cast<T>() * off;
    return true;
  }
};

class GemanMcClure final : public ceres::LossFunction {
 public:
  explicit GemanMcClure(const double& bound) : bound_(bound) {}
  void Evaluate(double s, double out[3]) const override {
    const double share = bound_ / (bound_ + s);
    out[0] = s * share;
    out[1] = share * share;
    out[2] = -2 * share * share / (bound_ + s);
  }

 private:
  const double& bound_;
};

template <int N>
Eigen::Matrix<double, N, N> whitening(const Eigen::Matrix<double, N, N>& covariance) {
  const Eigen::Matrix<double, N, N> lower = covariance.llt().matrixL();
  return lower.template triangularView<Eigen::Lower>().solve(Eigen::Matrix<double, N, N>::Identity());
}

// The flight filter's, of white acceleration and of the wind, which does not turn.
Eigen::Matrix4d carry_noise(double dt, double turn) {
  const FlightFilter::Options options;
  const double q = options.steady_acceleration_mps2 * options.steady_acceleration_mps2;
  const double gust = options.wind_sigma_mps * options.wind_sigma_mps * turn * turn;
  Eigen::Matrix4d noise;
  const auto I = Eigen::Matrix2d::Identity();
  noise << I * (q * dt * dt * dt / 3 + gust * dt * dt / 4), I * (q * dt * dt / 2 + gust * dt / 2),
      I * (q * dt * dt / 2 + gust * dt / 2), I * (q * dt + gust);
  return noise;
}

double cpu_s() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

template <typename Cost, int Rows, int... Blocks>
auto cost_of(const Cost& cost) {
  return new ceres::AutoDiffCostFunction<Cost, Rows, Blocks...>(new Cost(cost));
}

}  // namespace

BatchGraph solve_batch(const test::DrawnFlight& flight, const TelemetryUncertainty& uncertainty, bool covariances) {
  const double began = cpu_s();
  const std::size_t n = flight.steps.size();
  std::vector<State> x(n, State::Zero());
  double heading_bias = 0, bound = 1;
  ceres::Problem::Options problem_options;
  problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(problem_options);
  GemanMcClure loss(bound);
  const FlightFilter::Options filter;
  State sigma = State::Ones();
  sigma.head<4>() << 20, 20, filter.start_velocity_sigma_mps, filter.start_velocity_sigma_mps;
  sigma[kHeight] = uncertainty.agl_relative;
  sigma[kTiltBias] = sigma[kTiltBias + 1] = uncertainty.tilt_rad;
  const double deviation_rad = model::kDeviationShare * uncertainty.heading_rad;
  sigma[kDeviation] = sigma[kDeviation + 1] = deviation_rad;
  for (std::size_t i = 0; i < n; ++i) {
    x[i].head<2>() = flight.frames[i].online_m;
    x[i][kHeading] = *flight.steps[i].measured_heading_rad;
    if (i > 0) x[i].segment<2>(kVelocity) = (x[i] - x[i - 1]).head<2>() / flight.steps[i].seconds;
  }
  problem.AddResidualBlock(cost_of<Bias, 1, 1>({model::kHeadingBiasShare * uncertainty.heading_rad}), nullptr,
                           &heading_bias);
  problem.AddResidualBlock(cost_of<Begin, 9, kStates>({State::Zero(), sigma}), nullptr, x[0].data());
  for (std::size_t i = 0; i < n; ++i) {
    const FlightStep& step = flight.steps[i];
    const double heading = *step.measured_heading_rad;
    problem.AddResidualBlock(
        cost_of<HeadingResidual, 3, kStates, 1>({heading, model::kWhiteHeadingShare * uncertainty.heading_rad,
                                                 model::kWhiteTiltShareLogged * uncertainty.tilt_rad}),
        nullptr, x[i].data(), &heading_bias);
    if (i > 0) {
      const double keep = std::exp(-step.seconds / model::kTiltTimeLogged_s),
                   kept = std::exp(-step.seconds / model::kDeviationTime_s),
                   turn = wrap_pi(heading - *flight.steps[i - 1].measured_heading_rad);
      problem.AddResidualBlock(
          cost_of<Carry, 9, kStates, kStates>(
              {step.seconds, std::sqrt(1 - model::kHeightInnovationShare * model::kHeightInnovationShare),
               model::kHeightInnovationShare * uncertainty.agl_relative, keep,
               uncertainty.tilt_rad * std::sqrt(1 - keep * keep), turn, kept,
               deviation_rad * std::sqrt(1 - kept * kept), whitening<4>(carry_noise(step.seconds, turn))}),
          nullptr, x[i - 1].data(), x[i].data());
    }
    if (step.relative_motion) {
      problem.AddResidualBlock(
          cost_of<Moved, 8, kStates, kStates>({*step.relative_motion, whitening<8>(step.relative_motion->covariance)}),
          nullptr, x[i - 1].data(), x[i].data());
    }
    if (step.anchor) {
      problem.AddResidualBlock(cost_of<Anchored, 6, kStates>({*step.anchor, whitening<6>(step.anchor->covariance)}),
                               &loss, x[i].data());
    }
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.max_num_iterations = 50;
  options.num_threads = 1;
  // From a loss that accepts all to one that rejects those beyond 50 (six degrees of freedom).
  for (bound = 50.0 * 4096; bound >= 50; bound /= 8) {
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
  }
  bound = 50;
  BatchGraph graph;
  graph.solve_s = cpu_s() - began;
  const double solved = cpu_s();
  std::vector<Eigen::Matrix2d> spread(n, Eigen::Matrix2d::Zero());
  if (covariances) {
    ceres::Covariance::Options how;
    how.num_threads = 1;
    ceres::Covariance covariance(how);
    std::vector<std::pair<const double*, const double*>> blocks;
    for (const State& state : x) blocks.emplace_back(state.data(), state.data());
    if (covariance.Compute(blocks, &problem)) {
      for (std::size_t i = 0; i < n; ++i) {
        Eigen::Matrix<double, kStates, kStates, Eigen::RowMajor> block;
        covariance.GetCovarianceBlock(x[i].data(), x[i].data(), block.data());
        spread[i] = block.topLeftCorner<2, 2>();
      }
    }
  }
  graph.covariance_s = cpu_s() - solved;
  for (std::size_t i = 0; i < n; ++i) graph.frames.push_back({x[i].head<2>(), spread[i]});
  return graph;
}

}  // namespace nadir::bench
