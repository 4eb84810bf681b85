// How well the pictures of a dataset are localized on its map: every frame by itself, or all of them as one flight; and
// how often place retrieval finds where they were taken.
//
// By itself: the frame is searched in a square of camera positions whose middle
// is drawn around the true one, at most 0.8 of its half side off along each axis (the same seed, the same squares),
// with the height and attitude that the dataset states. A candidate is accepted when its weight of evidence alone is
// enough (parameters::belief::kUnambiguous), without any other frame.
//
// As a flight: the localizer as it flies (replay/replay_flight.hpp), started at the first true position.
//
// Programs that answer for every frame are compared by all candidates; what an aircraft would navigate by is the
// accepted ones.
#pragma once

#include <array>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/monotonic.hpp"
#include "base/progress.hpp"
#include "cli/output.hpp"
#include "datasets/map_datasets.hpp"
#include "datasets/place_recall.hpp"
#include "planning/raster_tiles.hpp"

namespace nadir {

struct PlacedFrame {
  std::string name;
  LonLat truth;
  std::optional<LonLat> position{};  // of the candidate, or of the estimate
  double error_m = 0;                // where there is one
  bool accepted = false;
  double log_likelihood_ratio = 0;  // of a candidate
  double ms = 0;                    // decoding and matching
  std::string verdict;              // accepted, doubtful, no_candidate, no_map, unreadable
};

struct PlacementOptions {
  double search_m = 100;  // half side of the searched square
  std::uint64_t seed = 1;
  MonotonicMs clock = steady_clock_ms;
};

std::vector<PlacedFrame> place_frames(const DatasetFlight& flight, const RasterTiles& tiles,
                                      const PlacementOptions& options, Progress& progress);
std::vector<PlacedFrame> place_flight(const DatasetFlight& flight, const RasterTiles& tiles, Progress& progress);

// How often the place index of the whole map names the place of a frame: one layer, its chunks as large as the median
// frame. flights: at least one, all over this map.
struct MapRecall {
  std::size_t chunks = 0;
  PlaceEvaluation of_frames;
};
MapRecall map_recall(std::span<const DatasetFlight> flights, const RasterTiles& tiles, const PlacementOptions& options,
                     int threads, Progress& progress);

struct PlacementFigures {
  std::size_t frames = 0, candidates = 0, accepted = 0;
  std::array<std::size_t, 3> within{};           // candidates so near the truth, by kWithin_m …
  std::array<std::size_t, 3> accepted_within{};  // … and the accepted of them
  std::size_t wrong = 0;                         // accepted, more than kWrongAnchor_m off
  double median_m = 0, mean_m = 0, p95_m = 0;    // of the accepted
  double candidate_median_m = 0;                 // of all candidates
  double ms_median = 0, ms_mean = 0;             // of a frame
};
inline constexpr std::array<double, 3> kWithin_m{5, 20, 50};

PlacementFigures figures_of(const std::vector<PlacedFrame>& frames);

nlohmann::json json_from(const PlacementFigures& figures);
Figures table_of(const PlacementFigures& figures);
std::string csv_of(const std::vector<PlacedFrame>& frames);

}  // namespace nadir
