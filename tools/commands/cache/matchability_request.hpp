// How a matchability map is asked for on the command line, and made for a tile set
// (package_build/matchability_survey.hpp).
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>

#include "base/progress.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "package/mission.hpp"
#include "package/vector_layer.hpp"
#include "package_build/matchability_survey.hpp"
#include "package_build/water_mask.hpp"

namespace nadir {

struct MatchabilityRequest {
  std::optional<std::filesystem::path> camera;
  std::optional<double> footprint_m;
  double search_m = 100;
  double step_m = 100;
  std::optional<double> cruise_mps;
  std::optional<int> threads;

  void declare(Options& options);
  int thread_count() const;
};

// A map with what is said about it.
struct MatchabilityResult {
  MatchabilityMap map{};
  MatchabilitySummary summary{};
  MatchabilityOptions options;
  double step_m = 0;
  std::optional<double> cruise_mps;
  std::optional<std::size_t> water_areas{};  // that were masked; none: without vectors
};

// A survey of a tile set's ground as it was asked for. The limits are the flight's gates
// (vision/localizer_parameters.hpp). vectors: of the package, null without them; their water is no ground to match with
// (package_build/water_mask.hpp).
class RequestedSurvey {
 public:
  // tiles, mission, vectors: must outlive it.
  RequestedSurvey(const TileSource& tiles, const Mission& mission, const VectorLayer* vectors,
                  const MatchabilityRequest& request);

  SharedWork& work() { return survey_; }
  MatchabilityResult finish();  // after all results

 private:
  const Mission& mission_;
  LocalFrame frame_;
  Region region_;
  VectorLayer without_;  // instead of the package's, where it has none
  WaterMaskedTiles ground_;
  MatchabilityResult result_;
  MatchabilitySurvey survey_;
};

// All of it here.
MatchabilityResult make_matchability(const std::filesystem::path& tiles, const Mission& mission,
                                     const VectorLayer* vectors, const MatchabilityRequest& request,
                                     Progress& progress);

// Of a package's folder; none where it has none. Throws Error where they differ from their digest, or cannot be read.
std::optional<VectorLayer> read_package_vectors(const std::filesystem::path& package, const Manifest& manifest);

Figures figures_of(const MatchabilityResult& result);
nlohmann::json json_of(const MatchabilityResult& result);

}  // namespace nadir
