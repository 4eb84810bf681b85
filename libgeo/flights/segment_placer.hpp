// Which floating segments of a stored flight are placed as wholes, and what becomes of it.
//
// A segment is tried once it is closed: no frame can continue it any more. It is tried again when a person has said
// more about one of its frames, and not at all once a person has taken its placement back. What is found depends on
// nothing but the stored frames, the map and the fixes, so that a flight that was interrupted, or is replayed, ends
// with the same segments placed in the same way.
//
//   placed        one transaction: the segment is merged, its frames have placed estimates, the event segments_merged
//   not placed    the event user_input_needed with the best candidates
//
// Work is done a little at a time (SegmentPlacement::step()); what a kill interrupts is done again from the beginning
// of the segment.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <utility>

#include "base/progress.hpp"
#include "base/time.hpp"
#include "estimation/localizer.hpp"
#include "flights/flight_store.hpp"
#include "flights/segment_placement.hpp"

namespace nadir {

// What the flight is localized with. Must outlive the placer, as must what it points to.
struct PlacerSetup {
  const CameraFile& camera;  // of the pictures as `read` returns them
  const LocalFrame& frame;
  const TileSource& tiles;
  const LocalizerConfig& localizer;
  std::function<cv::Mat(std::size_t frame)> read;  // CV_8UC1; empty: cannot be decoded
  std::function<UtcMillis()> clock;
};

enum class PlacerOutcome { nothing_to_do, more_to_do, merged };

// What placing segments has in common, however it is done.
SegmentShape stored_shape(const FlightStore& store, const FlightSegment& segment,
                          const TelemetryUncertainty& uncertainty);
// Variance of one axis of what no number of looks averages out: the map's own error, and that of the model of a
// picture.
double common_variance_m2(const LocalizerConfig& config, const std::optional<double>& map_ce90_m, double agl_m);
// The estimate of a frame at its place in the segment, and its heading and height.
EstimateRecord placed_estimate(const FlightStore& store, const PlacerSetup& setup, const ShapeFrame& frame,
                               const SegmentSimilarity::Pose& pose, double common_m2, SourceLabel source);

class SegmentPlacer {
 public:
  SegmentPlacer(FlightStore& store, const PlacerSetup& setup);
  ~SegmentPlacer();
  SegmentPlacer(const SegmentPlacer&) = delete;
  SegmentPlacer& operator=(const SegmentPlacer&) = delete;

  enum class Scope {
    closed,  // segments that no further frame can continue
    all      // the flight is complete: the last one as well
  };
  // The next search or look. Throws Interrupted when cancelled, and can be called again then.
  PlacerOutcome step(Scope scope, const Cancel& cancel);

 private:
  struct Attempt;
  // What an attempt depends on: when it differs, the segment is tried again.
  struct Inputs {
    std::size_t last_frame = 0;
    std::size_t statements = 0;
    bool operator==(const Inputs&) const = default;
  };

  bool begin_next(Scope scope);
  std::vector<PlaceStatement> statements_about(const FlightSegment& segment) const;
  std::optional<PlaceStatement> prediction_of(const FlightSegment& segment) const;
  bool finish();
  void report_rung();

  FlightStore& store_;
  PlacerSetup setup_;
  FlatGround flat_;
  std::unique_ptr<MapMatcher> matcher_;  // while there is something to do
  std::map<int, Inputs> tried_;          // by segment
  std::size_t attempts_ = 0;
  std::unique_ptr<Attempt> attempt_;
};

}  // namespace nadir
