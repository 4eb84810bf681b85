// How good the estimates are: counts by source and, where truth is known, errors and whether they were honest.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "estimation/estimate.hpp"
#include "geodesy/local_frame.hpp"
#include "replay/truth.hpp"

namespace nadir {

// An accepted anchor that is farther off than this is wrong, not inaccurate.
inline constexpr double kWrongAnchor_m = 50;

struct ErrorFigures {
  std::size_t scored = 0;  // frames with an estimate and a truth
  double median_m = 0, mean_m = 0, p95_m = 0, max_m = 0;
  double within_20_m_share = 0, within_50_m_share = 0;  // of the frames with truth
  double inside_50_share = 0, inside_95_share = 0;      // of the scored: truth inside the 50 % and 95 % ellipse
  std::size_t wrong_anchors = 0;                        // labelled satellite_anchored, more than kWrongAnchor_m off
};

struct LatencyFigures {
  double p50_ms = 0, p95_ms = 0, max_ms = 0;
};

struct Score {
  std::size_t frames = 0;
  std::array<std::size_t, 4> by_source{};  // indexed by SourceLabel
  double localized_share = 0;              // satellite_anchored
  LatencyFigures latency;
  std::optional<ErrorFigures> errors;
};

// Error of each frame in metres on the ground; nothing where estimate or truth is missing.
std::vector<std::optional<double>> errors_m(const std::vector<Estimate>& estimates, const Truth& truth,
                                            const LocalFrame& frame);

Score score(const std::vector<Estimate>& estimates, const Truth& truth, const LocalFrame& frame);

// The smallest value that at least `share` of the values do not exceed (nearest rank). 0 for none.
double quantile(std::vector<double> values, double share);

}  // namespace nadir
