#include "safety_judge.hpp"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "safety_world.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir::bench {
namespace {

constexpr double kWrong_m = 50;
constexpr double kFarSigmas = 3;
constexpr double kWrongMotion_m = 5, kWrongMotionShare = 0.25;  // heights are up to 15 % off
constexpr double kChi2_50 = 1.386, kChi2_95 = 5.991;            // two degrees of freedom

std::optional<Eigen::Vector2d> error_of(const Estimate& estimate, const CameraPose& truth) {
  if (!estimate.position) return std::nullopt;
  const PlanePoint at = frame().plane_from_lonlat(*estimate.position);
  return at - truth.position;
}

}  // namespace

std::optional<double> error_m(const Estimate& estimate, const CameraPose& truth) {
  const auto error = error_of(estimate, truth);
  return error ? std::optional(error->norm()) : std::nullopt;
}

void judge(const FrameReport& report, const CameraPose& truth, bool unknowable, Record& record) {
  const AnchorVerdict verdict = report.anchor.verdict;
  ++record.frames;
  if (verdict != AnchorVerdict::not_tried && verdict != AnchorVerdict::frame_unfit) ++record.attempts;
  bool bad = false;
  if (verdict == AnchorVerdict::accepted) {
    ++record.accepted;
    bad = !report.anchor.camera || (*report.anchor.camera - truth.position).norm() > kWrong_m;
    if (bad && !unknowable) ++record.wrong;
  }
  const Estimate& estimate = report.estimate;
  if (const auto error = error_of(estimate, truth)) {
    const double nees = error->dot(estimate.covariance_m2.inverse() * *error),
                 sigmas = error->norm() / estimate.sigma_m;
    const bool anchored = estimate.source == SourceLabel::satellite_anchored, far = sigmas > kFarSigmas;
    bad = bad || (anchored && far);
    if (!unknowable) {
      ++record.positioned;
      if (estimate.hpl_m) record.levels.push_back({error->norm(), *estimate.hpl_m});
      if (nees <= kChi2_50) ++record.in_50;
      if (nees <= kChi2_95) ++record.in_95;
      if (far) ++(anchored ? record.misleading : record.overconfident);
    }
    if (!unknowable && anchored) {
      ++record.anchored;
      record.nees += nees;
      record.worst_sigmas = std::max(record.worst_sigmas, sigmas);
      record.worst_m = std::max(record.worst_m, error->norm());
    }
  }
  if (bad && unknowable) ++record.unknowable;
}

void judge_motion(const OdometryReport& odometry, const CameraPose& truth, std::span<const CameraPose> before,
                  MotionCounts& motions) {
  if (odometry.inliers == 0) return;
  const bool wrong = std::ranges::all_of(before, [&](const CameraPose& from) {
    const double step_m = (truth.position - from.position).norm();
    return std::abs(odometry.step_m - step_m) > kWrongMotion_m + kWrongMotionShare * step_m;
  });
  ++motions
        .numbers[MotionCounts::index(odometry.inliers < parameters::tracking::kSureInliers, odometry.tracked, wrong)];
}

std::string frame_line(std::size_t frame, const FrameReport& report, const CameraPose& truth) {
  const AnchorReport& a = report.anchor;
  const double anchor_m = a.camera ? (*a.camera - truth.position).norm() : -1;
  const Eigen::Vector2d error = error_of(report.estimate, truth).value_or(Eigen::Vector2d::Zero());
  return fmt::format(
      "frame {}: {}, ratio {:.2f}, score {:.2f}, {} of {} patches, {:.2f} px, chi2 {:.2f}, window {:.0f} m, anchor "
      "{:.1f} m "
      "off; {}, {:.1f} m off ({:.1f} east, {:.1f} north), sigma {:.1f} m; odometry {} {} inliers {:.1f} m\n",
      frame, name_of(a.verdict), a.ratio, a.score, a.inliers, a.patches, a.residual_px, a.chi2, a.window_radius_m,
      anchor_m, name_of(report.estimate.source), error.norm(), error.x(), error.y(), report.estimate.sigma_m,
      report.odometry.tracked ? "tracked" : "lost", report.odometry.inliers, report.odometry.step_m);
}

}  // namespace nadir::bench
