#include "replay/score.hpp"

#include <fmt/format.h>
#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>
#include <unordered_map>

#include "base/csv.hpp"
#include "base/error.hpp"
#include "base/quantile.hpp"
#include "geodesy/hypotenuse.hpp"

namespace nadir {

Truth read_truth(const std::filesystem::path& path, const std::vector<Telemetry>& frames) {
  const CsvTable table = CsvTable::read(path);
  const std::size_t frame = table.required_column("frame");
  const std::size_t lat = table.required_column("lat_deg");
  const std::size_t lon = table.required_column("lon_deg");
  std::unordered_map<std::string, std::size_t> index;
  for (std::size_t i = 0; i < frames.size(); ++i) index.emplace(frames[i].frame, i);

  Truth truth(frames.size());
  std::size_t matched = 0;
  for (std::size_t row = 0; row < table.rows(); ++row) {
    const std::string where = fmt::format("{}:{}", path.string(), table.line_of(row));
    const auto found = index.find(table.cell(row, frame));
    if (found == index.end()) continue;  // truth of a longer flight
    if (truth[found->second]) {
      throw UsageError({.what = fmt::format("frame {} has two positions", found->first), .where = where});
    }
    const LonLat place{table.required_number(row, lon), table.required_number(row, lat)};
    if (std::abs(place.lon_deg) > 180 || std::abs(place.lat_deg) > 90) {
      throw UsageError({.what = "the position is out of range",
                        .where = where,
                        .expected = "lat_deg in -90 to 90, lon_deg in -180 to 180",
                        .found = fmt::format("{}, {}", place.lat_deg, place.lon_deg)});
    }
    truth[found->second] = place;
    ++matched;
  }
  if (matched == 0) {
    throw UsageError({.what = "the truth has none of the flight's frames",
                      .where = path.string(),
                      .expected = fmt::format("frames like {}", frames.front().frame),
                      .fix = "give the truth of this flight, or omit --truth"});
  }
  return truth;
}

namespace {

// Quantiles of chi-square with two degrees of freedom: -2 ln(1 - p).
constexpr double kChi2Half = 1.3862943611198906;
constexpr double kChi2NineteenOf20 = 5.991464547107979;

std::optional<Eigen::Vector2d> offset_of(const Estimate& estimate, const std::optional<LonLat>& truth,
                                         const LocalFrame& frame) {
  if (!estimate.position || !truth) return std::nullopt;
  return frame.plane_from_lonlat(*estimate.position) - frame.plane_from_lonlat(*truth);
}

// Squared Mahalanobis distance. Without a usable covariance the circle of sigma_m stands for the ellipse.
double mahalanobis2(const Estimate& estimate, const Eigen::Vector2d& offset) {
  const auto& c = estimate.covariance_m2;
  const double determinant = c(0, 0) * c(1, 1) - c(0, 1) * c(1, 0);
  if (c(0, 0) > 0 && determinant > 0) {
    return (c(1, 1) * offset.x() * offset.x() - 2 * c(0, 1) * offset.x() * offset.y() +
            c(0, 0) * offset.y() * offset.y()) /
           determinant;
  }
  const double sigma = std::max(estimate.sigma_m, 1e-9);
  return (offset.x() * offset.x() + offset.y() * offset.y()) / (sigma * sigma);
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
    const double error = hypotenuse(offset->x(), offset->y());
    const double chi2 = mahalanobis2(estimates[i], *offset);
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

std::vector<std::optional<double>> errors_m(const std::vector<Estimate>& estimates, const Truth& truth,
                                            const LocalFrame& frame) {
  std::vector<std::optional<double>> errors(estimates.size());
  for (std::size_t i = 0; i < estimates.size() && i < truth.size(); ++i) {
    if (const auto offset = offset_of(estimates[i], truth[i], frame)) {
      errors[i] = hypotenuse(offset->x(), offset->y());
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

IntegrityFigures integrity_figures(const std::vector<Estimate>& estimates, const Truth& truth, const LocalFrame& frame,
                                   double alert_limit_m) {
  IntegrityFigures result;
  result.alert_limit_m = alert_limit_m;
  result.frames = estimates.size();
  const auto errors = errors_m(estimates, truth, frame);
  std::vector<double> levels_m;
  for (std::size_t i = 0; i < estimates.size(); ++i) {
    result.has_truth = result.has_truth || (i < truth.size() && truth[i]);
    if (!estimates[i].position) continue;
    const std::optional<double>& level_m = estimates[i].hpl_m;
    if (!level_m) {
      ++result.without_level;
      continue;
    }
    levels_m.push_back(*level_m);
    const bool within = *level_m <= alert_limit_m;
    result.usable += within;
    if (!errors[i]) continue;
    ++result.scored;
    const bool held = *errors[i] <= *level_m;
    if (!within) {
      ++(held ? result.unavailable : result.unavailable_misleading);
    } else {
      ++(held ? result.available : *errors[i] <= alert_limit_m ? result.misleading : result.hazardously_misleading);
    }
  }
  result.hpl_p50_m = quantile(levels_m, 0.5);
  result.hpl_p95_m = quantile(levels_m, 0.95);
  return result;
}

namespace {

constexpr SourceLabel kSources[] = {SourceLabel::satellite_anchored, SourceLabel::vo_extrapolated,
                                    SourceLabel::dead_reckoned, SourceLabel::no_fix};

// Figures are rounded: digits beyond a millimetre or a ten-thousandth mean nothing.
double rounded_to(double value, double steps) { return std::round(value * steps) / steps; }
double millimetres(double value) { return rounded_to(value, 1000); }
double share_of(double value) { return rounded_to(value, 10000); }

nlohmann::json json_from(const ErrorFigures& e) {
  return {{"scored", e.scored},
          {"median_m", millimetres(e.median_m)},
          {"mean_m", millimetres(e.mean_m)},
          {"p95_m", millimetres(e.p95_m)},
          {"max_m", millimetres(e.max_m)},
          {"within_20_m_share", share_of(e.within_20_m_share)},
          {"within_50_m_share", share_of(e.within_50_m_share)},
          {"wrong_anchors", e.wrong_anchors},
          {"inside_50_share", share_of(e.inside_50_share)},
          {"inside_95_share", share_of(e.inside_95_share)}};
}

nlohmann::json json_from(const IntegrityFigures& i) {
  nlohmann::json document = {{"alert_limit_m", i.alert_limit_m},
                             {"usable_share", share_of(share(i.usable, i.frames))},
                             {"without_level", i.without_level},
                             {"hpl_p50_m", millimetres(i.hpl_p50_m)},
                             {"hpl_p95_m", millimetres(i.hpl_p95_m)}};
  if (!i.has_truth) return document;
  document.update({{"scored", i.scored},
                   {"available", i.available},
                   {"misleading", i.misleading},
                   {"hazardously_misleading", i.hazardously_misleading},
                   {"unavailable", i.unavailable},
                   {"unavailable_misleading", i.unavailable_misleading}});
  return document;
}

std::string percent(double share) { return fmt::format("{:.1f} %", 100 * share); }

}  // namespace

nlohmann::json json_from(const Summary& summary) {
  const Score& s = summary.streamed;
  nlohmann::json sources = nlohmann::json::object();
  for (const SourceLabel label : kSources)
    sources[std::string(name_of(label))] = s.by_source[static_cast<std::size_t>(label)];
  nlohmann::json document = {{"schema", "nadir.replay-summary/1"},
                             {"frames", s.frames},
                             {"sources", std::move(sources)},
                             {"localized_share", share_of(s.localized_share)},
                             {"latency_p50_ms", rounded_to(s.latency.p50_ms, 10)},
                             {"latency_p95_ms", rounded_to(s.latency.p95_ms, 10)},
                             {"latency_max_ms", rounded_to(s.latency.max_ms, 10)},
                             {"peak_memory_mb", rounded_to(summary.peak_memory_mb, 10)},
                             {"integrity", json_from(summary.integrity)}};
  if (s.errors) document.update(json_from(*s.errors));
  if (summary.refined.errors) document["refined"] = json_from(*summary.refined.errors);
  if (summary.adjusted && summary.adjusted->errors) document["adjusted"] = json_from(*summary.adjusted->errors);
  return document;
}

Figures figures_from(const Summary& summary) {
  const Score& s = summary.streamed;
  Figures figures{{"frames", fmt::format("{}", s.frames)}};
  for (const SourceLabel label : kSources) {
    const std::size_t count = s.by_source[static_cast<std::size_t>(label)];
    if (count != 0) figures.emplace_back(std::string(name_of(label)), fmt::format("{}", count));
  }
  if (const auto& e = s.errors) {
    figures.emplace_back("median error", fmt::format("{:.1f} m", e->median_m));
    figures.emplace_back("mean error", fmt::format("{:.1f} m", e->mean_m));
    figures.emplace_back("95 % of errors below", fmt::format("{:.1f} m", e->p95_m));
    figures.emplace_back("largest error", fmt::format("{:.1f} m", e->max_m));
    figures.emplace_back("within 20 m", percent(e->within_20_m_share));
    figures.emplace_back("within 50 m", percent(e->within_50_m_share));
    figures.emplace_back("anchors wrong by > 50 m", fmt::format("{}", e->wrong_anchors));
    figures.emplace_back("truth inside the 50 % ellipse", percent(e->inside_50_share));
    figures.emplace_back("truth inside the 95 % ellipse", percent(e->inside_95_share));
  }
  if (const auto& e = summary.refined.errors) {
    figures.emplace_back("smoothed: median error", fmt::format("{:.1f} m", e->median_m));
    figures.emplace_back("smoothed: 95 % of errors below", fmt::format("{:.1f} m", e->p95_m));
  }
  if (summary.adjusted && summary.adjusted->errors) {
    const ErrorFigures& e = *summary.adjusted->errors;
    figures.emplace_back("adjusted: median error", fmt::format("{:.1f} m", e.median_m));
    figures.emplace_back("adjusted: 95 % of errors below", fmt::format("{:.1f} m", e.p95_m));
  }
  const IntegrityFigures& i = summary.integrity;
  figures.emplace_back(fmt::format("protection level within {} m", i.alert_limit_m),
                       percent(share(i.usable, i.frames)));
  if (i.hpl_p50_m > 0) {
    figures.emplace_back("protection level, median", fmt::format("{:.0f} m", i.hpl_p50_m));
    figures.emplace_back("protection level, 95 %", fmt::format("{:.0f} m", i.hpl_p95_m));
  }
  if (i.without_level != 0) {
    figures.emplace_back("positions without a protection level", fmt::format("{}", i.without_level));
  }
  if (i.has_truth) {
    figures.emplace_back("misleading (error beyond the level)",
                         fmt::format("{}", i.misleading + i.hazardously_misleading + i.unavailable_misleading));
    figures.emplace_back("hazardously misleading", fmt::format("{}", i.hazardously_misleading));
  }
  figures.emplace_back("time per frame, median", fmt::format("{:.0f} ms", s.latency.p50_ms));
  figures.emplace_back("time per frame, 95 %", fmt::format("{:.0f} ms", s.latency.p95_ms));
  figures.emplace_back("peak memory", fmt::format("{:.0f} MB", summary.peak_memory_mb));
  return figures;
}

double peak_memory_mb() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) * 1024 / 1e6;
}

}  // namespace nadir
