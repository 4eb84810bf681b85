#include "provision/gyro_delay.hpp"

#include <ceres/ceres.h>
#include <ceres/normal_prior.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

#include "base/quantile.hpp"
#include "estimation/odometry_features.hpp"
#include "estimation/visual_odometry.hpp"
#include "vision/camera_frame.hpp"

namespace nadir {
namespace {

constexpr double kLongestPair_s = 3;     // between two frames; with more they hardly overlap
constexpr double kLongestDelay_s = 0.5;  // that is looked for, either way
constexpr double kGridStep_s = 0.02;     // far less than any turn takes
constexpr double kNoDelayPrior_s = 10, kBiasPrior_rad_s = 0.02, kMountPrior_rad = 0.035;  // none; 1 °/s; 2°
constexpr double kTiltSigma_rad = 0.05;     // of the telemetry's pitch and roll, which are those of another moment
constexpr double kLeastSigma_rad = 0.0005;  // of an image's turn; a tenth of a pixel half a frame from its centre
constexpr double kScaleError = 0.005;       // of a MEMS gyroscope
constexpr double kOutlierSigmas = 4;        // from where on a pair counts less (Huber); three axes
constexpr std::size_t kLeastTurns = 10;
constexpr double kTurning_rad = 0.05;    // far above the noise of any pair
constexpr double kStraightShare = 0.25;  // of the pairs: evenly chosen, they tell the biases

enum TurnUnknown { turn_delay, turn_bias, turn_mount = turn_bias + 3, kTurnUnknowns = turn_mount + 3 };
using TurnUnknowns = Eigen::Matrix<double, kTurnUnknowns, 1>;

// The samples' axes are image-up, image-right and optical axis; the camera's are x right, y down, z ahead.
Eigen::Matrix3d camera_from_samples(const Eigen::Vector3d& mount_rad) {
  Eigen::Matrix3d axes;
  axes << 0, 1, 0, -1, 0, 0, 0, 0, 1;
  return rotation_of(mount_rad) * axes;
}

std::optional<Eigen::Matrix3d> turn_of_samples(const ImageTurn& turn, std::span<const InertialSample> samples,
                                               const TurnUnknowns& x) {
  const double from_s = turn.from_s - x[turn_delay], to_s = turn.to_s - x[turn_delay];
  const auto first = std::ranges::lower_bound(samples, from_s, {}, &InertialSample::time_s);
  auto last = std::ranges::lower_bound(first, samples.end(), to_s, {}, &InertialSample::time_s);
  if (last != samples.end()) ++last;  // the sample within which it ends
  const auto motion =
      preintegrate(std::span(first, last), from_s, to_s, {x.segment<3>(turn_bias), Eigen::Vector3d::Zero()});
  if (!motion) return std::nullopt;
  const Eigen::Matrix3d axes = camera_from_samples(x.segment<3>(turn_mount));
  return axes * motion->turn * axes.transpose();
}

Eigen::Matrix3d turn_of_image(const ImageTurn& turn) {
  return enu_from_camera(turn.before).transpose() * enu_from_camera(turn.now);
}

struct TurnResidual {
  const ImageTurn& turn;
  std::span<const InertialSample> samples;
  Eigen::Matrix3d root;  // information = rootᵀ root

  TurnResidual(const ImageTurn& of, std::span<const InertialSample> all)
      : turn(of), samples(all), root(of.covariance_rad2.inverse().llt().matrixU()) {}

  bool operator()(const double* x, double* residuals) const {
    const auto measured = turn_of_samples(turn, samples, Eigen::Map<const TurnUnknowns>(x));
    if (!measured) return false;
    Eigen::Map<Eigen::Vector3d>(residuals, 3) = root * rotation_vector_of(measured->transpose() * turn_of_image(turn));
    return true;
  }
};

// Pairs around which samples exist, whatever delay is tried.
std::vector<ImageTurn> covered(const std::vector<ImageTurn>& turns, std::span<const InertialSample> samples) {
  std::vector<ImageTurn> result;
  for (const ImageTurn& turn : turns) {
    ImageTurn widest = turn;
    widest.from_s -= kLongestDelay_s;
    widest.to_s += kLongestDelay_s;
    if (turn_of_samples(widest, samples, TurnUnknowns::Zero())) result.push_back(turn);
  }
  return result;
}

// By the sum of the angles between both turns; that of the biases is the same for all delays, or nearly so.
double best_of_grid(const std::vector<ImageTurn>& turns, std::span<const InertialSample> samples) {
  double best = 0, least = std::numeric_limits<double>::infinity();
  for (double delay_s = -kLongestDelay_s + kGridStep_s; delay_s < kLongestDelay_s; delay_s += kGridStep_s) {
    TurnUnknowns x = TurnUnknowns::Zero();
    x[turn_delay] = delay_s;
    double cost = 0;
    for (const ImageTurn& turn : turns) {
      const auto measured = turn_of_samples(turn, samples, x);
      if (measured) cost += rotation_vector_of(measured->transpose() * turn_of_image(turn)).norm();
    }
    if (cost < least) least = cost, best = delay_s;
  }
  return best;
}

// Of a turn whose unknowns (change of heading; pitch and roll before; pitch and roll now) have that covariance.
Eigen::Matrix3d turn_covariance(const ImageTurn& turn, const Eigen::Matrix<double, 5, 5>& covariance) {
  constexpr double kStep_rad = 1e-6;
  const Eigen::Matrix3d middle = turn_of_image(turn);
  Eigen::Matrix<double, 3, 5> jacobian;
  for (int i = 0; i < 5; ++i) {
    ImageTurn near = turn;
    (i == 0   ? near.now.heading_rad
     : i == 1 ? near.before.pitch_rad
     : i == 2 ? near.before.roll_rad
     : i == 3 ? near.now.pitch_rad
              : near.now.roll_rad) += kStep_rad;
    jacobian.col(i) = rotation_vector_of(middle.transpose() * turn_of_image(near)) / kStep_rad;
  }
  const double scale_rad = kScaleError * rotation_vector_of(middle).norm();
  const double least_rad2 = kLeastSigma_rad * kLeastSigma_rad + scale_rad * scale_rad;
  return jacobian * covariance * jacobian.transpose() + least_rad2 * Eigen::Matrix3d::Identity();
}

std::vector<std::size_t> chosen_pairs(const std::vector<Telemetry>& frames, std::span<const InertialSample> samples,
                                      std::size_t most) {
  const auto rate_at = [&](double time_s) {
    const auto at = std::ranges::lower_bound(samples, time_s, {}, &InertialSample::time_s);
    return at == samples.end() ? 0.0 : at->rate_rad_s.z();
  };
  const auto known = [](const Telemetry& frame) {
    return frame.agl_m && frame.heading_rad && frame.pitch_rad && frame.roll_rad;
  };
  std::vector<std::size_t> pairs;  // each by its second frame
  for (std::size_t i = 1; i < frames.size(); ++i) {
    const double apart_s = frames[i].time_s - frames[i - 1].time_s;
    if (known(frames[i - 1]) && known(frames[i]) && apart_s <= kLongestPair_s) pairs.push_back(i);
  }
  if (pairs.size() <= most) return pairs;
  const auto straight = static_cast<std::size_t>(kStraightShare * static_cast<double>(most));
  std::vector<std::size_t> chosen;
  for (std::size_t k = 0; k < straight; ++k) chosen.push_back(pairs[k * pairs.size() / straight]);
  std::stable_sort(pairs.begin(), pairs.end(), [&](std::size_t a, std::size_t b) {
    const auto change = [&](std::size_t i) {
      return std::abs(rate_at(frames[i].time_s) - rate_at(frames[i - 1].time_s));
    };
    return change(a) > change(b);
  });
  chosen.insert(chosen.end(), pairs.begin(), pairs.begin() + static_cast<std::ptrdiff_t>(most - straight));
  std::sort(chosen.begin(), chosen.end());
  chosen.erase(std::unique(chosen.begin(), chosen.end()), chosen.end());
  return chosen;
}

}  // namespace

std::vector<InertialSample> inertial_samples(const Flight& flight) {
  std::vector<InertialSample> samples;
  for (const Telemetry& frame : flight.frames)
    samples.insert(samples.end(), frame.inertial.begin(), frame.inertial.end());
  return usable_samples(samples, -std::numeric_limits<double>::infinity());
}

std::vector<ImageTurn> measure_image_turns(const Flight& flight, const std::vector<InertialSample>& samples,
                                           const CameraFile& camera, const Attitude& assumed_mount,
                                           const Attitude& mount, std::size_t most_pairs, Progress& progress) {
  const std::vector<std::size_t> pairs = chosen_pairs(flight.frames, samples, most_pairs);
  const int shrink = decode_reduction(camera.camera.width, camera.camera.height);
  const CameraModel decoded = camera.camera.scaled(1.0 / shrink);
  const auto attitude_at = [&](std::size_t i) {
    const Telemetry& frame = flight.frames[i];
    return camera_attitude(aircraft_attitude({*frame.heading_rad, *frame.pitch_rad, *frame.roll_rad}, assumed_mount),
                           mount);
  };
  const auto features_at = [&](std::size_t i) -> std::optional<OdometryFeatures> {
    OdometryFrame seen;
    seen.grey = read_flight_image(flight.image_path(i), decoded, shrink);
    if (seen.grey.empty()) return std::nullopt;
    seen.camera = decoded;
    seen.attitude = attitude_at(i);
    seen.agl_m = *flight.frames[i].agl_m;
    seen.linearization_point.heading_rad = seen.attitude.heading_rad;
    return odometry_features(seen);
  };

  std::vector<ImageTurn> turns;
  std::optional<OdometryFeatures> now;
  std::size_t now_is = 0;
  progress.begin("turns between frames", pairs.size(), "pairs");
  for (const std::size_t i : pairs) {
    progress.advance(1);
    std::optional<OdometryFeatures> before = now && now_is == i - 1 ? std::move(now) : features_at(i - 1);
    now = features_at(i);
    now_is = i;
    if (!before || !now) continue;
    const auto measured = measure_motion(before->frame, now->frame, similar_pixels(*before, *now));
    if (!measured) continue;
    // The images alone, but for their common tilt, which hardly matters.
    const TwoViewMotion& motion = measured->motion;
    Eigen::Matrix<double, 8, 8> information = motion.measurement_information;
    information.diagonal().tail<4>().array() += 1 / (kTiltSigma_rad * kTiltSigma_rad);
    const Eigen::Matrix<double, 8, 8> covariance = information.inverse();
    const Eigen::Matrix<double, 8, 1> seen =
        covariance * (motion.measurement_information * motion.solved + motion.measurement_gradient);
    ImageTurn turn{flight.frames[i - 1].time_s, flight.frames[i].time_s, before->frame.attitude, now->frame.attitude};
    turn.before.pitch_rad += seen[4];
    turn.before.roll_rad += seen[5];
    turn.now.heading_rad += seen[3];
    turn.now.pitch_rad += seen[6];
    turn.now.roll_rad += seen[7];
    turn.covariance_rad2 = turn_covariance(turn, covariance.bottomRightCorner<5, 5>());
    turns.push_back(turn);
  }
  progress.end();
  return turns;
}

std::optional<GyroDelay> solve_gyro_delay(const std::vector<ImageTurn>& all_turns,
                                          const std::vector<InertialSample>& samples) {
  const std::vector<ImageTurn> turns = covered(all_turns, samples);
  if (turns.size() < kLeastTurns) return std::nullopt;
  TurnUnknowns x = TurnUnknowns::Zero(), prior = TurnUnknowns::Zero(), sigma;
  sigma << kNoDelayPrior_s, Eigen::Vector3d::Constant(kBiasPrior_rad_s), Eigen::Vector3d::Constant(kMountPrior_rad);
  x[turn_delay] = best_of_grid(turns, samples);
  ceres::Problem problem;
  for (const ImageTurn& turn : turns) {
    using Cost = ceres::NumericDiffCostFunction<TurnResidual, ceres::CENTRAL, 3, kTurnUnknowns>;
    problem.AddResidualBlock(new Cost(new TurnResidual(turn, samples)), new ceres::HuberLoss(kOutlierSigmas), x.data());
  }
  problem.AddResidualBlock(new ceres::NormalPrior(ceres::Matrix(sigma.cwiseInverse().asDiagonal()), prior), nullptr,
                           x.data());
  problem.SetParameterLowerBound(x.data(), turn_delay, -kLongestDelay_s);
  problem.SetParameterUpperBound(x.data(), turn_delay, kLongestDelay_s);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  if (!summary.IsSolutionUsable()) return std::nullopt;

  GyroDelay result{x[turn_delay], 0, x.segment<3>(turn_bias), x.segment<3>(turn_mount)};
  std::vector<double> squares;
  int turning = 0;  // pairs that fit, less those that do not: straight ones fit whatever the samples' axes are
  for (const ImageTurn& turn : turns) {
    Eigen::Vector3d error = Eigen::Vector3d::Zero();
    TurnResidual(turn, samples)(x.data(), error.data());
    squares.push_back(error.squaredNorm());
    const bool fits = error.norm() < kOutlierSigmas;
    ++(fits ? result.used : result.outliers);
    if (rotation_vector_of(turn_of_image(turn)).norm() > kTurning_rad) turning += fits ? 1 : -1;
  }
  // A delay beyond what is looked for, samples in other axes: nothing fits, however well the rest is known.
  if (std::abs(result.delay_s) > kLongestDelay_s - kGridStep_s || turning < 0) return std::nullopt;
  ceres::Covariance::Options covariance_options;
  covariance_options.num_threads = 1;
  ceres::Covariance covariance(covariance_options);
  if (!covariance.Compute(std::vector<const double*>{x.data()}, &problem)) return std::nullopt;
  Eigen::Matrix<double, kTurnUnknowns, kTurnUnknowns, Eigen::RowMajor> of_unknowns;
  covariance.GetCovarianceBlock(x.data(), x.data(), of_unknowns.data());
  // What the images' own covariances do not know (lens, shutter) shows in how far the pairs scatter.
  constexpr double kMedianChi2 = 2.37;  // of three degrees of freedom
  const double excess = std::max(1.0, median(std::move(squares)) / kMedianChi2);
  result.sigma_s = std::sqrt(of_unknowns(turn_delay, turn_delay) * excess);
  return result;
}

}  // namespace nadir
