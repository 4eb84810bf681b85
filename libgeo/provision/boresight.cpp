#include "provision/boresight.hpp"

#include <fmt/format.h>

#include <ceres/ceres.h>
#include <ceres/normal_prior.h>
#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "estimation/look_likelihood.hpp"
#include "estimation/pose_measurements.hpp"
#include "estimation/terrain_surface.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/hypotenuse.hpp"
#include "replay/flight_folder.hpp"
#include "vision/camera_frame.hpp"
#include "vision/map_matcher.hpp"
#include "vision/matching_plan.hpp"

namespace nadir {
namespace {

enum Unknown { yaw, pitch, roll, delay, east, north, log_height, kUnknowns };
using Unknowns = Eigen::Matrix<double, kUnknowns, 1>;
using Normal = Eigen::Matrix<double, kUnknowns, kUnknowns>;
using Measured = Eigen::Matrix<double, 6, 1>;

constexpr double kTelemetryMinute_s = 60;  // its errors are correlated for so long: the frames of a minute count as one
constexpr double kMaxChi2 = 25;            // squared sigmas, six degrees of freedom: an outlier
constexpr double kDelayPrior_s = 0.5, kObservableDelay_s = 0.05, kFixedDelay_s = 0.005;
constexpr double kGyroDelayFloor_s = 0.002;  // telemetry and gyroscopes do not share a clock better than that
constexpr double kFree_rad = 1;              // no prior on the mount
constexpr int kRounds = 15;                  // of weights; within each Ceres solves to its minimum
constexpr double kTolerance = 1e-10;         // of the sum of squares, relative
constexpr double kMaxMisfit = 3;

Measured predicted(const BoresightMeasurement& measurement, const Unknowns& x) {
  const auto earlier = [&](double value, double rate) { return value - rate * x[delay]; };
  const Attitude aircraft{earlier(measurement.aircraft.heading_rad, measurement.rate_rad_s.heading_rad),
                          earlier(measurement.aircraft.pitch_rad, measurement.rate_rad_s.pitch_rad),
                          earlier(measurement.aircraft.roll_rad, measurement.rate_rad_s.roll_rad)};
  const Attitude camera = camera_attitude(aircraft, {x[yaw], x[pitch], x[roll]});
  Measured seen;
  seen << measurement.gps_position.east_m - measurement.velocity_mps.x() * x[delay] + x[east],
      measurement.gps_position.north_m - measurement.velocity_mps.y() * x[delay] + x[north], x[log_height],
      camera.heading_rad, camera.pitch_rad, camera.roll_rad;
  return seen;
}

Measured residual(const BoresightMeasurement& measurement, const Unknowns& x) {
  Measured difference = measurement.seen - predicted(measurement, x);
  for (int i = 3; i < 6; ++i) difference[i] = wrap_pi(difference[i]);
  return difference;
}

// Whitened with the frame's information: information = rootᵀ root.
struct FrameResidual {
  const BoresightMeasurement& measurement;
  Eigen::Matrix<double, 6, 6> root;

  bool operator()(const double* x, double* residuals) const {
    Eigen::Map<Measured>(residuals, 6) = root * residual(measurement, Eigen::Map<const Unknowns>(x));
    return true;
  }
};

struct Solution {
  Unknowns x;
  Normal covariance;
  std::size_t used = 0;
  double misfit = 0;
};

class Solver {
 public:
  Solver(const std::vector<BoresightMeasurement>& measurements, const BoresightSettings& settings)
      : measurements_(measurements), settings_(settings) {
    const double flown_s = std::max(measurements.back().time_s - measurements.front().time_s, 1.0);
    const double in_a_minute = static_cast<double>(measurements.size()) * std::min(kTelemetryMinute_s / flown_s, 1.0);
    const TelemetryUncertainty& u = settings.uncertainty;
    Measured sigmas;
    sigmas << settings.gps_sigma_m, settings.gps_sigma_m, u.agl_relative, u.heading_rad, u.tilt_rad, u.tilt_rad;
    const Eigen::Matrix<double, 6, 6> noise = sigmas.cwiseProduct(sigmas).asDiagonal();
    for (const BoresightMeasurement& measurement : measurements) {
      const Eigen::Matrix<double, 6, 6> single = measurement.covariance + noise;
      single_.push_back(single.inverse());
      const Eigen::Matrix<double, 6, 6> shared =
          (measurement.covariance + noise * std::max(in_a_minute, 1.0)).inverse();
      shared_root_.push_back(shared.llt().matrixU());
    }
  }

  // Nothing when Ceres finds no solution.
  std::optional<Solution> solve(double delay_s, double delay_sigma_s) const {
    ceres::Vector prior(kUnknowns), sigma(kUnknowns);
    prior << settings_.mount.heading_rad, settings_.mount.pitch_rad, settings_.mount.roll_rad, delay_s, 0, 0, 0;
    sigma << kFree_rad, kFree_rad, kFree_rad, delay_sigma_s, settings_.offset_sigma_m, settings_.offset_sigma_m,
        settings_.uncertainty.agl_relative;
    Solution solution{prior, Normal::Zero()};
    // Whether a frame is an outlier is decided by its own error alone, while it counts with that which it shares with
    // its neighbours. No loss function knows both: weights are fixed within a round.
    for (int round = 0; round < kRounds; ++round) {
      ceres::Problem problem;
      double* x = solution.x.data();
      problem.AddResidualBlock(new ceres::NormalPrior(ceres::Matrix(sigma.cwiseInverse().asDiagonal()), prior), nullptr,
                               x);
      solution.used = 0;
      double squares = 0;
      for (std::size_t i = 0; i < measurements_.size(); ++i) {
        const Measured difference = residual(measurements_[i], solution.x);
        const double squared = difference.dot(single_[i] * difference);
        // The first rounds use all measurements with Cauchy weights, the others those inside the gate.
        const double weight = round < kRounds / 3 ? 1 / (1 + squared / kMaxChi2) : squared < kMaxChi2 ? 1.0 : 0.0;
        if (weight == 0) continue;
        ++solution.used;
        squares += squared;
        using Cost = ceres::NumericDiffCostFunction<FrameResidual, ceres::CENTRAL, 6, kUnknowns>;
        const Eigen::Matrix<double, 6, 6> root = std::sqrt(weight) * shared_root_[i];
        problem.AddResidualBlock(new Cost(new FrameResidual{measurements_[i], root}), nullptr, x);
      }
      solution.misfit = solution.used == 0 ? 0 : squares / static_cast<double>(6 * solution.used);
      if (!fit(problem)) return std::nullopt;
      if (round + 1 < kRounds) continue;
      ceres::Covariance::Options options;
      options.num_threads = 1;
      ceres::Covariance covariance(options);
      const double* const blocks[] = {x};
      if (!covariance.Compute(std::vector<const double*>(std::begin(blocks), std::end(blocks)), &problem)) {
        return std::nullopt;
      }
      Eigen::Matrix<double, kUnknowns, kUnknowns, Eigen::RowMajor> of_unknowns;
      covariance.GetCovarianceBlock(x, x, of_unknowns.data());
      solution.covariance = of_unknowns;
    }
    return solution;
  }

 private:
  static bool fit(ceres::Problem& problem) {
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_QR;
    options.num_threads = 1;
    options.function_tolerance = kTolerance;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    return summary.IsSolutionUsable();
  }

  const std::vector<BoresightMeasurement>& measurements_;
  const BoresightSettings& settings_;
  std::vector<Eigen::Matrix<double, 6, 6>> single_;       // information of one frame alone …
  std::vector<Eigen::Matrix<double, 6, 6>> shared_root_;  // … and the root of that as one of many with a common error
};

}  // namespace

std::optional<Boresight> solve_boresight(const std::vector<BoresightMeasurement>& measurements,
                                         const BoresightSettings& settings) {
  if (measurements.size() < 3) return std::nullopt;
  const Solver solver(measurements, settings);
  const auto& gyro = settings.gyro_delay;
  std::optional<Solution> solved = gyro && gyro->sigma_s < kDelayPrior_s
                                       ? solver.solve(gyro->delay_s, std::max(gyro->sigma_s, kGyroDelayFloor_s))
                                       : solver.solve(0, kDelayPrior_s);
  if (!solved) return std::nullopt;
  Boresight result;
  result.delay_sigma_s = std::sqrt(solved->covariance(delay, delay));
  result.delay_observable = result.delay_sigma_s < kObservableDelay_s;
  if (!result.delay_observable) solved = solver.solve(0, kFixedDelay_s);
  if (!solved || !solved->x.allFinite()) return std::nullopt;
  const Solution& solution = *solved;
  const auto sigma = [&](Unknown of) { return std::sqrt(solution.covariance(of, of)); };
  result.mount = {wrap_pi(solution.x[yaw]), wrap_pi(solution.x[pitch]), wrap_pi(solution.x[roll])};
  result.mount_sigma = {sigma(yaw), sigma(pitch), sigma(roll)};
  result.delay_s = result.delay_observable ? solution.x[delay] : 0;
  result.offset_m = {solution.x[east], solution.x[north]};
  result.height_factor = std::exp(solution.x[log_height]);
  result.used = solution.used;
  result.outliers = measurements.size() - solution.used;
  result.misfit = solution.misfit;
  return result;
}

Findings check_boresight(const std::optional<Boresight>& boresight, const BoresightLimits& limits) {
  Findings findings;
  if (!boresight || boresight->used < limits.min_frames) {
    findings.add({.code = "provision.few_anchors",
                  .expected = fmt::format("at least {} frames that are found on the map and agree", limits.min_frames),
                  .found = std::to_string(boresight ? boresight->used : 0),
                  .fix = "fly longer over the package's area, with GPS good and at its usual height"});
    return findings;
  }
  const double tilt_deg = degrees(std::max(boresight->mount_sigma.pitch_rad, boresight->mount_sigma.roll_rad));
  const double yaw_deg = degrees(boresight->mount_sigma.heading_rad);
  if (tilt_deg > limits.max_tilt_sigma_deg || yaw_deg > limits.max_yaw_sigma_deg) {
    findings.add({.code = "provision.boresight_unsure",
                  .expected = fmt::format("pitch and roll known to {:.1f}°, yaw to {:.1f}°", limits.max_tilt_sigma_deg,
                                          limits.max_yaw_sigma_deg),
                  .found = fmt::format("{:.2f}° and {:.2f}°", tilt_deg, yaw_deg),
                  .fix = "fly legs in all directions, there and back: only they separate the mount from GPS's offset"});
  }
  if (boresight->misfit > kMaxMisfit) {
    findings.add(
        {.code = "provision.boresight_misfit",
         .expected = "frames that agree within the telemetry's uncertainty",
         .found = fmt::format("{:.1f} times its square", boresight->misfit),
         .fix = "check that GPS was good throughout (--from-s, --to-s), the camera's file and its uncertainty"});
  }
  constexpr double kMaxTilt_deg = 45;  // airframe.json
  if (std::abs(degrees(boresight->mount.pitch_rad)) > kMaxTilt_deg ||
      std::abs(degrees(boresight->mount.roll_rad)) > kMaxTilt_deg) {
    findings.add({.code = "provision.boresight_range",
                  .expected = "a camera that looks down",
                  .found = fmt::format("pitch {:.0f}°, roll {:.0f}°", degrees(boresight->mount.pitch_rad),
                                       degrees(boresight->mount.roll_rad)),
                  .fix = "check the mount in the airframe's file, from which the search began"});
  }
  return findings;
}

namespace {

constexpr double kMountRange_rad = 0.2;  // search range around the expected mount, each angle
constexpr double kLeastRadius_m = 60;    // of the search around GPS
constexpr double kLongestStep_s = 3;     // between frames, for rates
constexpr double kLeastEvidence =
    4.6;  // ln 100, of a frame that is used: one chance peak in a hundred passes; the solver drops it

bool complete(const Telemetry& telemetry) {
  return telemetry.gps_position && telemetry.agl_m && telemetry.heading_rad && telemetry.pitch_rad &&
         telemetry.roll_rad;
}

// Position, velocity, attitude and its rate at a frame, from its neighbours.
BoresightMeasurement measurement_at(const std::vector<Telemetry>& frames, std::size_t at, const LocalFrame& frame,
                                    const Attitude& assumed_mount) {
  const auto aircraft = [&](const Telemetry& telemetry) {
    return aircraft_attitude({*telemetry.heading_rad, *telemetry.pitch_rad, *telemetry.roll_rad}, assumed_mount);
  };
  const auto place = [&](const Telemetry& telemetry) { return frame.plane_from_lonlat(*telemetry.gps_position); };
  BoresightMeasurement measurement;
  measurement.time_s = frames[at].time_s;
  measurement.gps_position = place(frames[at]);
  measurement.aircraft = aircraft(frames[at]);
  const Telemetry& before = frames[at > 0 && complete(frames[at - 1]) ? at - 1 : at];
  const Telemetry& after = frames[at + 1 < frames.size() && complete(frames[at + 1]) ? at + 1 : at];
  const double step_s = after.time_s - before.time_s;
  if (step_s <= 0 || step_s > 2 * kLongestStep_s) return measurement;
  const Attitude first = aircraft(before), last = aircraft(after);
  measurement.velocity_mps = (place(after) - place(before)) / step_s;
  measurement.rate_rad_s = {wrap_pi(last.heading_rad - first.heading_rad) / step_s,
                            (last.pitch_rad - first.pitch_rad) / step_s,
                            wrap_pi(last.roll_rad - first.roll_rad) / step_s};
  return measurement;
}

AnchorPrior prior_of(const BoresightMeasurement& measurement, const Attitude& mount, double agl_m,
                     const TelemetryUncertainty& uncertainty) {
  AnchorPrior prior;
  prior.search.pose = {measurement.gps_position, agl_m, camera_attitude(measurement.aircraft, mount)};
  prior.search.radius_m = std::max(kLeastRadius_m, 1.5 * agl_m * std::tan(kMountRange_rad));
  prior.heading_sigma_rad = hypotenuse(uncertainty.heading_rad, kMountRange_rad / 2);
  prior.search.heading_range_rad = 2 * prior.heading_sigma_rad;
  prior.log_agl_sigma = uncertainty.agl_relative;
  prior.search.scale_range = 2.5 * uncertainty.agl_relative;
  const double tilt_rad = hypotenuse(uncertainty.tilt_rad, kMountRange_rad / 2);
  prior.tilt_covariance_rad2 = Eigen::Matrix2d::Identity() * tilt_rad * tilt_rad;
  return prior;
}

std::vector<std::size_t> chosen(const std::vector<Telemetry>& frames, std::size_t most) {
  std::vector<std::size_t> usable, evenly;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (complete(frames[i])) usable.push_back(i);
  }
  if (usable.size() <= most) return usable;
  for (std::size_t i = 0; i < most; ++i) evenly.push_back(usable[i * usable.size() / most]);
  return evenly;
}

}  // namespace

BoresightMeasurements measure_boresight(const BoresightFlight& from, const CameraFile& camera, const Attitude& mount,
                                        const OpenPackage& package, Progress& progress) {
  const LocalFrame frame = mission_frame(package.mission());
  const FlatGround flat;
  std::optional<TerrainSurface> terrain;
  if (package.terrain() != nullptr) terrain.emplace(*package.terrain(), frame, package.mission().terrain.height_m);
  const GroundSurface& surface = terrain ? static_cast<const GroundSurface&>(*terrain) : flat;
  const int shrink = decode_reduction(camera.camera.width, camera.camera.height);
  const CameraModel decoded = camera.camera.scaled(1.0 / shrink);
  const auto matcher = make_channel_matcher({decoded, package.imagery(), frame, surface});

  BoresightMeasurements result;
  const auto& frames = from.flight.frames;
  const std::vector<std::size_t> matched = chosen(frames, from.most_frames);
  result.frames = matched.size();
  progress.begin("matching with the map", matched.size(), "frames");
  for (const std::size_t i : matched) {
    progress.advance(1);
    const cv::Mat grey = read_flight_image(from.flight.image_path(i), decoded, shrink);
    if (grey.empty()) continue;
    BoresightMeasurement measurement = measurement_at(frames, i, frame, from.assumed_mount);
    const AnchorPrior prior = prior_of(measurement, mount, *frames[i].agl_m, camera.uncertainty);
    const AnchorMatch match = matcher->match(grey, prior);
    const PlaneBox searched = square_around(prior.search.pose.position, prior.search.radius_m);
    if (!match.solved) continue;
    if (log_likelihood_ratio(features_of(match, prior, searched.area_m2())) < kLeastEvidence) continue;
    const PoseMeasurement seen = pose_measurement(*match.solved, {*frames[i].agl_m, Eigen::Vector2d::Zero()});
    measurement.seen = seen.value;
    measurement.covariance = seen.covariance;
    result.measurements.push_back(measurement);
  }
  progress.end();
  return result;
}

}  // namespace nadir
