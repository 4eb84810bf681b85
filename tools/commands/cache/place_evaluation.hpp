// How often does the place index name the right chunk among its first 1, 5 and 20? Asked with the frames of a flight
// whose truth is known, or with views that are made of the map itself.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>

#include "base/progress.hpp"
#include "imagery/tile_source.hpp"
#include "package/mission.hpp"
#include "vision/place_index.hpp"

namespace nadir {

// A hit: the true place lies inside the square of one of the first k chunks. For frames the true place is the
// aircraft's, for views of the map the middle of the view.
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

struct PlaceEvaluation {
  PlaceRecall known;         // heading wrong by a uniform error within ± heading_range_rad
  PlaceRecall unknown;       // any heading
  std::size_t left_out = 0;  // frames without truth, height or heading, or damaged
};

struct EvaluationOptions {
  double heading_range_rad = 0.2618;  // 15 degrees
  std::uint64_t seed = 1;
};

// A folder with frames/, telemetry.csv, camera.yaml and truth.csv. camera: instead of the folder's.
PlaceEvaluation evaluate_frames(const PlaceIndex& index, const Mission& mission, const std::filesystem::path& folder,
                                const std::optional<std::filesystem::path>& camera, const EvaluationOptions& options,
                                Progress& progress);

// `count` views of the map as another day might show it: turned, up to 5 % larger or smaller, brighter or darker,
// less contrast, blurred, noisy; of the index's first layer, 4:3.
PlaceEvaluation evaluate_views(const PlaceIndex& index, const TileSource& tiles, std::size_t count,
                               const EvaluationOptions& options, Progress& progress);

}  // namespace nadir
