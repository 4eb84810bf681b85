// A recorded flight, replayed with different parts of the localizer.
#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "ablation_variants.hpp"
#include "estimation/localizer.hpp"
#include "replay/flight_folder.hpp"
#include "replay/score.hpp"

namespace nadir::bench {

struct RecordedFlight {
  Flight flight;
  CameraFile camera;  // of the frames as decoded
  Truth truth;
  std::vector<cv::Mat> pictures;
};

RecordedFlight recorded_flight(const FlightPaths& paths, const std::filesystem::path& truth);

// What a matcher is tested against.
struct FlownMap {
  const TileSource& tiles;
  LocalFrame frame;
  LocalizerConfig config;  // with area, terrain and the map's error
};

struct MatchingFigures {
  std::size_t frames = 0;
  std::size_t anchored = 0, wrong = 0;           // wrong: accepted, the matched position more than kWrongAnchor_m off
  std::size_t awaiting = 0, awaiting_wrong = 0;  // for more looks
  std::vector<double> error_m;                   // of the estimates in the anchored frames
  std::vector<double> attempt_ms;                // CPU
};

// start: where the flight begins, or nothing.
MatchingFigures fly(const RecordedFlight& recorded, const FlownMap& map, const MapMatcherFactory& matcher,
                    std::optional<LonLat> start);

struct SearchFigures {
  std::size_t frames = 0, right = 0;  // right: the best place lies within kWrongAnchor_m of the truth
  std::vector<double> ratio;
  std::vector<double> attempt_ms;
};

// Every `every`th frame by itself in a window of ±radius_m that holds its place somewhere; no gates, no filter.
SearchFigures search(const RecordedFlight& recorded, const FlownMap& map, const MapMatcherFactory& matcher,
                     double radius_m, std::size_t every);

struct DriftFigures {
  std::size_t frames = 0, tracked = 0;
  // RMS of a segment after turning and shifting it onto the truth, over its length; of all segments of five frames and
  // more, nothing when there is none.
  std::optional<double> drift_share;
  std::vector<double> step_ms;
};

// Without a map.
DriftFigures drift(const RecordedFlight& recorded, const OdometryFactory& odometry);

}  // namespace nadir::bench
