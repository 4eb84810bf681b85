// How often does a place index name the right chunk of the map among its first 1, 5 and 20? Asked with frames whose
// true position is known, twice each: with a heading that is off by a uniform error, and without one.
//
// A hit: the true place lies inside the square of one of the first k chunks. For frames the true place is the
// aircraft's, for views of the map the middle of the view. Chance is the share of hits that five chunks drawn blindly
// would have: high in a small area with overlapping chunks.
#pragma once

#include <cstddef>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <vector>

#include "base/progress.hpp"
#include "replay/flight_folder.hpp"
#include "replay/score.hpp"
#include "vision/place_index.hpp"

namespace nadir {

struct PlaceRecall {
  std::size_t queries = 0;
  std::size_t within_1 = 0;
  std::size_t within_5 = 0;
  std::size_t within_20 = 0;
  double chance_5 = 0;      // share of hits that five chunks drawn blindly would have, on average
  double query_ms_p50 = 0;  // describing and searching
  double query_ms_max = 0;

  double share(std::size_t hits) const {
    return queries == 0 ? 0 : static_cast<double>(hits) / static_cast<double>(queries);
  }
};

nlohmann::json json_from(const PlaceRecall& recall);
std::string text_from(const PlaceRecall& recall);

// Asks one query after the other; finish() completes the figures. Index and figures must outlive it.
class PlaceScorer {
 public:
  PlaceScorer(const PlaceIndex& index, PlaceRecall& recall);
  void ask(const PlaceQuery& query, LonLat truth);
  void finish();

 private:
  bool inside(LonLat centre, double side_m, LonLat place) const;
  void blind(LonLat truth, const std::vector<PlaceCandidate>& found);

  const PlaceIndex& index_;
  LocalFrame frame_;
  PlaceRecall& recall_;
  std::vector<double> times_ms_;
};

struct PlaceEvaluation {
  PlaceRecall known;         // heading wrong by a uniform error within ± heading_range_rad
  PlaceRecall unknown;       // any heading
  std::size_t left_out = 0;  // frames without truth, height or heading, or damaged
};

struct PlaceRecallOptions {
  double heading_range_rad = 0.2618;  // 15 degrees
  std::uint64_t seed = 1;
};

struct FlightWithTruth {
  const Flight& flight;
  const Truth& truth;  // one for each frame
};

// The frames of all of them, each flight with its own camera. usual_agl_m: of frames whose telemetry has no height.
PlaceEvaluation evaluate_frames(const PlaceIndex& index, std::span<const FlightWithTruth> flights, double usual_agl_m,
                                const PlaceRecallOptions& options, Progress& progress);

}  // namespace nadir
