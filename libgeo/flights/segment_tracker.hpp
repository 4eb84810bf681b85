// Segments of a flight, and the events that its frames cause.
//
// A segment is a stretch over which the relative motion is known: odometry tracked each of its frames from the one
// before. A new one begins where tracking is lost (a sharp turn, a picture of another place, a frame that is unfit).
// Where a single picture shows another place, it is skipped: it is a segment by itself, and the one before it goes on.
//
//   floating   nothing has tied it to the map yet
//   anchored   a look at the map was accepted in one of its frames
//   merged     it is placed as a whole (segment_placement.hpp)
//
// Deterministic: the same reports give the same segments and events, so that a flight that is resumed goes on with the
// state that it had.
#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "estimation/estimate.hpp"
#include "geodesy/local_frame.hpp"

namespace nadir {

enum class SegmentState { floating, anchored, merged };
std::string_view name_of(SegmentState state);

struct FlightSegment {
  int number = 0;  // Estimate::segment
  std::size_t first_frame = 0, last_frame = 0;
  SegmentState state = SegmentState::floating;
  std::optional<std::size_t> anchored_frame{};  // the first one that was anchored

  bool operator==(const FlightSegment&) const = default;
};

// What can happen to a flight. The names are stable (docs/flights.md has the members of each).
enum class FlightEventKind {
  flight_created,
  pictures_accepted,  // a batch
  frame_processed,    // its first estimate
  frame_refined,      // a better one
  search_expanded,    // looks at the map found nothing, and a larger window is searched
  segment_started,
  segment_anchored,
  segments_merged,     // one was placed as a whole
  merge_withdrawn,     // and a person has taken that back
  user_input_needed,   // three looks in a row found nothing
  user_fix,            // a person said where
  fix_withdrawn,       // and has withdrawn it
  objects_changed,     // a person marked, named or removed an object
  diagnosis_changed,   // why the first pictures match nowhere, or that they do
  processing_blocked,  // cannot go on: a picture is missing, the disk is full
  flight_completed
};
std::string_view name_of(FlightEventKind kind);
std::optional<FlightEventKind> parse_flight_event(std::string_view name);

struct StoredFlightEvent {
  FlightEventKind kind = FlightEventKind::frame_processed;
  std::optional<std::size_t> frame;
  std::string body = "{}";  // JSON, an object
};

class SegmentTracker {
 public:
  struct Changes {
    std::vector<FlightSegment> segments;  // that began or changed
    std::vector<StoredFlightEvent> events;
  };

  SegmentTracker() = default;                                          // without candidates
  explicit SegmentTracker(const LocalFrame& plane) : plane_(plane) {}  // of the reports

  // Reports in the order of frames, from 0.
  Changes on_frame(const FrameReport& report);

 private:
  std::optional<LocalFrame> plane_;
  std::size_t frame_ = 0;
  std::map<int, FlightSegment> segments_;  // by number: one goes on after an outlier
  int failed_looks_ = 0;                   // in a row
  double announced_window_m_ = 0;          // half the side, of the failed looks
};

}  // namespace nadir
