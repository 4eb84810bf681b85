#include "provision/boresight.hpp"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "geodesy/angles.hpp"

namespace nadir {
namespace {

enum Unknown { yaw, pitch, roll, delay, east, north, log_height, kUnknowns };
using Unknowns = Eigen::Matrix<double, kUnknowns, 1>;
using Normal = Eigen::Matrix<double, kUnknowns, kUnknowns>;
using Seen = Eigen::Matrix<double, 6, 1>;

constexpr double kTelemetryMinute_s = 60;  // its errors last so long: the frames of a minute are one witness
constexpr double kFarthest = 25;           // squared sigmas, six degrees of freedom: no anchor of this flight
constexpr double kDelayPrior_s = 0.5, kDelaySeen_s = 0.05, kDelayAsTold_s = 0.005;
constexpr double kFree_rad = 1;  // the mount may be anything
constexpr int kRounds = 15;
constexpr double kMostMisfit = 3;

Seen predicted(const BoresightSight& sight, const Unknowns& x) {
  const auto earlier = [&](double value, double rate) { return value - rate * x[delay]; };
  const Attitude aircraft{earlier(sight.aircraft.heading_rad, sight.rate_rad_s.heading_rad),
                          earlier(sight.aircraft.pitch_rad, sight.rate_rad_s.pitch_rad),
                          earlier(sight.aircraft.roll_rad, sight.rate_rad_s.roll_rad)};
  const Attitude camera = camera_attitude(aircraft, {x[yaw], x[pitch], x[roll]});
  Seen seen;
  seen << sight.gps_m.x() - sight.velocity_mps.x() * x[delay] + x[east],
      sight.gps_m.y() - sight.velocity_mps.y() * x[delay] + x[north], x[log_height], camera.heading_rad,
      camera.pitch_rad, camera.roll_rad;
  return seen;
}

Seen residual(const BoresightSight& sight, const Unknowns& x) {
  Seen difference = sight.seen - predicted(sight, x);
  for (int i = 3; i < 6; ++i) difference[i] = wrap_pi(difference[i]);
  return difference;
}

Eigen::Matrix<double, 6, kUnknowns> jacobian(const BoresightSight& sight, const Unknowns& x) {
  constexpr double kStep = 1e-5;
  Eigen::Matrix<double, 6, kUnknowns> slopes;
  for (int i = 0; i < kUnknowns; ++i) {
    Unknowns above = x, below = x;
    above[i] += kStep;
    below[i] -= kStep;
    slopes.col(i) = (residual(sight, below) - residual(sight, above)) / (2 * kStep);
  }
  return slopes;
}

struct Solution {
  Unknowns x;
  Normal covariance;
  std::size_t used = 0;
  double misfit = 0;
};

class Solver {
 public:
  Solver(const std::vector<BoresightSight>& sights, const BoresightSettings& settings)
      : sights_(sights), settings_(settings) {
    const double flown_s = std::max(sights.back().time_s - sights.front().time_s, 1.0);
    const double in_a_minute = static_cast<double>(sights.size()) * std::min(kTelemetryMinute_s / flown_s, 1.0);
    const TelemetryUncertainty& u = settings.uncertainty;
    Seen sigmas;
    sigmas << settings.gps_sigma_m, settings.gps_sigma_m, u.agl_relative, u.heading_rad, u.tilt_rad, u.tilt_rad;
    const Eigen::Matrix<double, 6, 6> noise = sigmas.cwiseProduct(sigmas).asDiagonal();
    for (const BoresightSight& sight : sights) {
      const Eigen::Matrix<double, 6, 6> single = sight.covariance + noise;
      single_.push_back(single.inverse());
      shared_.push_back((sight.covariance + noise * std::max(in_a_minute, 1.0)).inverse());
    }
  }

  Solution solve(double delay_sigma_s) const {
    Unknowns prior, sigma;
    prior << settings_.mount.heading_rad, settings_.mount.pitch_rad, settings_.mount.roll_rad, 0, 0, 0, 0;
    sigma << kFree_rad, kFree_rad, kFree_rad, delay_sigma_s, settings_.offset_sigma_m, settings_.offset_sigma_m,
        settings_.uncertainty.agl_relative;
    const Unknowns weight = sigma.cwiseProduct(sigma).cwiseInverse();
    Solution solution{prior, Normal::Zero()};
    for (int round = 0; round < kRounds; ++round) {
      Normal normal = weight.asDiagonal();
      Unknowns right = weight.cwiseProduct(prior - solution.x);
      solution.used = 0;
      double squares = 0;
      for (std::size_t i = 0; i < sights_.size(); ++i) {
        const Seen difference = residual(sights_[i], solution.x);
        const double squared = difference.dot(single_[i] * difference);
        // The first rounds take everybody's word, less that of those who are far off.
        const double vote = round < kRounds / 3 ? 1 / (1 + squared / kFarthest) : squared < kFarthest ? 1.0 : 0.0;
        if (vote == 0) continue;
        ++solution.used;
        squares += squared;
        const auto slopes = jacobian(sights_[i], solution.x);
        normal += vote * slopes.transpose() * shared_[i] * slopes;
        right += vote * slopes.transpose() * shared_[i] * difference;
      }
      solution.covariance = normal.inverse();
      solution.x += solution.covariance * right;
      solution.misfit = solution.used == 0 ? 0 : squares / static_cast<double>(6 * solution.used);
    }
    return solution;
  }

 private:
  const std::vector<BoresightSight>& sights_;
  const BoresightSettings& settings_;
  std::vector<Eigen::Matrix<double, 6, 6>> single_;  // information of one frame …
  std::vector<Eigen::Matrix<double, 6, 6>> shared_;  // … and as one of many that err alike
};

}  // namespace

std::optional<Boresight> solve_boresight(const std::vector<BoresightSight>& sights, const BoresightSettings& settings) {
  if (sights.size() < 3) return std::nullopt;
  const Solver solver(sights, settings);
  Solution solution = solver.solve(kDelayPrior_s);
  Boresight result;
  result.delay_sigma_s = std::sqrt(solution.covariance(delay, delay));
  result.delay_seen = result.delay_sigma_s < kDelaySeen_s;
  if (!result.delay_seen) solution = solver.solve(kDelayAsTold_s);
  if (!solution.x.allFinite()) return std::nullopt;
  const auto sigma = [&](Unknown of) { return std::sqrt(solution.covariance(of, of)); };
  result.mount = {wrap_pi(solution.x[yaw]), wrap_pi(solution.x[pitch]), wrap_pi(solution.x[roll])};
  result.mount_sigma = {sigma(yaw), sigma(pitch), sigma(roll)};
  result.delay_s = result.delay_seen ? solution.x[delay] : 0;
  result.offset_m = {solution.x[east], solution.x[north]};
  result.height_factor = std::exp(solution.x[log_height]);
  result.used = solution.used;
  result.set_aside = sights.size() - solution.used;
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
                  .fix = "fly legs in all directions, there and back: only they tell the mount from GPS's offset"});
  }
  if (boresight->misfit > kMostMisfit) {
    findings.add(
        {.code = "provision.boresight_misfit",
         .expected = "frames that agree within the telemetry's uncertainty",
         .found = fmt::format("{:.1f} times its square", boresight->misfit),
         .fix = "check that GPS was good throughout (--from-s, --to-s), the camera's file and its uncertainty"});
  }
  constexpr double kMostTilt_deg = 45;  // airframe.json
  if (std::abs(degrees(boresight->mount.pitch_rad)) > kMostTilt_deg ||
      std::abs(degrees(boresight->mount.roll_rad)) > kMostTilt_deg) {
    findings.add({.code = "provision.boresight_range",
                  .expected = "a camera that looks down",
                  .found = fmt::format("pitch {:.0f}°, roll {:.0f}°", degrees(boresight->mount.pitch_rad),
                                       degrees(boresight->mount.roll_rad)),
                  .fix = "check the mount in the airframe's file, from which the search began"});
  }
  return findings;
}

}  // namespace nadir
