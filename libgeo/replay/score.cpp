#include "replay/score.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace nadir {
namespace {

// Quantiles of chi-square with two degrees of freedom: -2 ln(1 - p).
constexpr double kChi2Half = 1.3862943611198906;
constexpr double kChi2NineteenOf20 = 5.991464547107979;

struct Offset {
  double east_m = 0, north_m = 0;
};

std::optional<Offset> offset_of(const Estimate& estimate, const std::optional<LonLat>& truth, const LocalFrame& frame) {
  if (!estimate.position || !truth) return std::nullopt;
  const Enu said = frame.enu_from_lonlat(*estimate.position);
  const Enu real = frame.enu_from_lonlat(*truth);
  return Offset{said.east_m - real.east_m, said.north_m - real.north_m};
}

// Squared Mahalanobis distance. Without a usable covariance the circle of sigma_m stands for the ellipse.
double surprise(const Estimate& estimate, const Offset& offset) {
  const auto& c = estimate.covariance_m2;
  const double determinant = c(0, 0) * c(1, 1) - c(0, 1) * c(1, 0);
  if (c(0, 0) > 0 && determinant > 0) {
    return (c(1, 1) * offset.east_m * offset.east_m - 2 * c(0, 1) * offset.east_m * offset.north_m +
            c(0, 0) * offset.north_m * offset.north_m) /
           determinant;
  }
  const double sigma = std::max(estimate.sigma_m, 1e-9);
  return (offset.east_m * offset.east_m + offset.north_m * offset.north_m) / (sigma * sigma);
}

double share(std::size_t part, std::size_t whole) {
  return whole == 0 ? 0 : static_cast<double>(part) / static_cast<double>(whole);
}

ErrorFigures figures(const std::vector<Estimate>& estimates, const Truth& truth, const LocalFrame& frame) {
  ErrorFigures result;
  std::vector<double> errors;
  std::size_t known = 0, within_20 = 0, within_50 = 0, inside_50 = 0, inside_95 = 0;
  for (std::size_t i = 0; i < estimates.size(); ++i) {
    known += truth[i].has_value();
    const auto offset = offset_of(estimates[i], truth[i], frame);
    if (!offset) continue;
    const double error = std::hypot(offset->east_m, offset->north_m);
    const double chi2 = surprise(estimates[i], *offset);
    errors.push_back(error);
    within_20 += error <= 20;
    within_50 += error <= 50;
    inside_50 += chi2 <= kChi2Half;
    inside_95 += chi2 <= kChi2NineteenOf20;
    result.wrong_anchors += estimates[i].source == SourceLabel::satellite_anchored && error > kWrongAnchor_m;
  }
  result.scored = errors.size();
  result.within_20_m_share = share(within_20, known);
  result.within_50_m_share = share(within_50, known);
  result.inside_50_share = share(inside_50, errors.size());
  result.inside_95_share = share(inside_95, errors.size());
  if (errors.empty()) return result;
  result.mean_m = std::accumulate(errors.begin(), errors.end(), 0.0) / static_cast<double>(errors.size());
  result.median_m = quantile(errors, 0.5);
  result.p95_m = quantile(errors, 0.95);
  result.max_m = quantile(errors, 1);
  return result;
}

}  // namespace

double quantile(std::vector<double> values, double wanted_share) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  const auto rank = static_cast<std::size_t>(std::ceil(wanted_share * static_cast<double>(values.size())));
  return values[std::clamp<std::size_t>(rank, 1, values.size()) - 1];
}

std::vector<std::optional<double>> errors_m(const std::vector<Estimate>& estimates, const Truth& truth,
                                            const LocalFrame& frame) {
  std::vector<std::optional<double>> errors(estimates.size());
  for (std::size_t i = 0; i < estimates.size() && i < truth.size(); ++i) {
    if (const auto offset = offset_of(estimates[i], truth[i], frame)) {
      errors[i] = std::hypot(offset->east_m, offset->north_m);
    }
  }
  return errors;
}

Score score(const std::vector<Estimate>& estimates, const Truth& truth, const LocalFrame& frame) {
  Score result;
  result.frames = estimates.size();
  std::vector<double> latencies;
  for (const Estimate& estimate : estimates) {
    ++result.by_source[static_cast<std::size_t>(estimate.source)];
    latencies.push_back(estimate.latency_ms);
  }
  result.localized_share =
      share(result.by_source[static_cast<std::size_t>(SourceLabel::satellite_anchored)], estimates.size());
  result.latency = {quantile(latencies, 0.5), quantile(latencies, 0.95), quantile(latencies, 1)};
  const bool has_truth = std::any_of(truth.begin(), truth.end(), [](const auto& place) { return place.has_value(); });
  if (has_truth) result.errors = figures(estimates, truth, frame);
  return result;
}

}  // namespace nadir
