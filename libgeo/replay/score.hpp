// How good the estimates of a replay are: ground truth, errors against it, and the summary of both.
//
// Figures are counts by source and, where truth is known, errors on the ground and the consistency of the stated
// covariance: the squared Mahalanobis distance of the truth is chi-square distributed with two degrees of freedom, so
// half of the truths should lie within 2 ln 2 (the 50 % ellipse) and 95 % within -2 ln 0.05. Truth never reaches the
// localizer.
#pragma once

#include <array>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <vector>

#include "cli/output.hpp"
#include "estimation/estimate.hpp"
#include "estimation/telemetry.hpp"
#include "geodesy/local_frame.hpp"
#include "geodesy/lon_lat.hpp"

namespace nadir {

using Truth = std::vector<std::optional<LonLat>>;  // one per frame of the flight; nullopt where unknown

// truth.csv: frame,lat_deg,lon_deg[,alt_m]. Throws UsageError for frames that the flight does not have or that come
// twice, and for impossible positions.
Truth read_truth(const std::filesystem::path& path, const std::vector<Telemetry>& frames);

// An accepted anchor that is farther off than this is wrong, not inaccurate.
inline constexpr double kWrongAnchor_m = 50;

struct ErrorFigures {
  std::size_t scored = 0;  // frames with an estimate and a truth
  double median_m = 0, mean_m = 0, p95_m = 0, max_m = 0;
  double within_20_m_share = 0, within_50_m_share = 0;  // of the frames with truth
  double inside_50_share = 0, inside_95_share = 0;      // of the scored: truth inside the 50 % and 95 % ellipse
  std::size_t wrong_anchors = 0;                        // labelled satellite_anchored, more than kWrongAnchor_m off
};

// Protection levels (estimation/belief.hpp) against the alert limit and, where truth is known, against the errors: the
// regions of the Stanford diagram (Walter et al., "Integrity lessons from the WAAS integrity performance panel", 2003).
//
//                       error <= level     error > level
//   level <= limit      available          misleading; hazardously where the error is beyond the limit as well
//   level > limit       unavailable        unavailable and misleading: nobody used it
struct IntegrityFigures {
  double alert_limit_m = 100;
  std::size_t frames = 0;
  std::size_t usable = 0;         // with a position whose level is within the limit
  std::size_t without_level = 0;  // with a position, and no radius is known to hold it
  double hpl_p50_m = 0, hpl_p95_m = 0;
  bool has_truth = false;
  std::size_t scored = 0;  // with a position, a level and a truth: the sum of the following
  std::size_t available = 0, misleading = 0, hazardously_misleading = 0, unavailable = 0, unavailable_misleading = 0;
};

IntegrityFigures integrity_figures(const std::vector<Estimate>& estimates, const Truth& truth, const LocalFrame& frame,
                                   double alert_limit_m);

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

// For summary.json, and for the table on the terminal and in the report.
struct Summary {
  Score streamed;
  Score refined;
  std::optional<Score> adjusted{};  // by block adjustment, where it was asked for
  IntegrityFigures integrity;
  double peak_memory_mb = 0;  // of this process, 10^6 bytes
};

nlohmann::json json_from(const Summary& summary);
Figures figures_from(const Summary& summary);

double peak_memory_mb();

}  // namespace nadir
