#include "replay/summary.hpp"

#include <fmt/format.h>
#include <sys/resource.h>

#include <cmath>
#include <nlohmann/json.hpp>

namespace nadir {
namespace {

constexpr SourceLabel kSources[] = {SourceLabel::satellite_anchored, SourceLabel::vo_extrapolated,
                                    SourceLabel::dead_reckoned, SourceLabel::no_fix};

// Figures are rounded: digits beyond a millimetre or a ten-thousandth mean nothing.
double rounded(double value, double steps) { return std::round(value * steps) / steps; }
double millimetres(double value) { return rounded(value, 1000); }
double share_of(double value) { return rounded(value, 10000); }

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
                             {"latency_p50_ms", rounded(s.latency.p50_ms, 10)},
                             {"latency_p95_ms", rounded(s.latency.p95_ms, 10)},
                             {"latency_max_ms", rounded(s.latency.max_ms, 10)},
                             {"peak_memory_mb", rounded(summary.peak_memory_mb, 10)}};
  if (s.errors) document.update(json_from(*s.errors));
  if (summary.refined.errors) document["refined"] = json_from(*summary.refined.errors);
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
