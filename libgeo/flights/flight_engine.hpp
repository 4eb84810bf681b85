// Localizes the pictures of a stored flight, one after the other, and goes on where it stopped.
//
//   const auto store = FlightStore::open(folder);
//   FlightEngine engine(*store, setup);
//   engine.process();    // what is there; again when more pictures have been accepted
//   engine.complete();   // the whole flight: refined estimates
//
// Each frame ends in one transaction: what vision found in it, its estimate, its segment, its events. A process that
// dies loses the frame that it was working at and nothing else. The next engine estimates the stored frames again from
// what vision found (recorded_vision.hpp), compares the result with the stored estimates bit for bit, and continues
// with the real front ends: the estimates are the same as those of a flight that was never interrupted.
//
// One thread at a time; pictures and fixes may be given to the store by others meanwhile.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "base/progress.hpp"
#include "base/time.hpp"
#include "estimation/localizer.hpp"
#include "flights/flight_store.hpp"
#include "flights/segment_placer.hpp"

namespace nadir {

using MillisClock = std::function<UtcMillis()>;
UtcMillis system_clock_millis();

// What the localizer is made of. Must agree with the flight's description, which keeps its values.
struct FlightEngineSetup {
  CameraFile camera;                  // of the pictures as they are
  int shrink = 1;                     // pictures are decoded at 1 / this of their size
  LocalFrame frame;                   // the plane of the estimates
  const TileSource* tiles = nullptr;  // null: odometry alone
  std::optional<LonLat> start;
  LocalizerConfig localizer;
};

struct FlightEngineOptions {
  MillisClock clock = system_clock_millis;  // of events
  bool keep_looks = true;                   // the images of each look at the map, to be shown beside each other
};

// A frame's report, after it was stored. restored: it was processed by an engine before this one; its images are those
// that were kept.
using FrameListener = std::function<void(std::size_t frame, FrameReport& report, bool restored)>;

class FlightEngine {
 public:
  // Everything that `setup` points to, and the store, must outlive the engine.
  FlightEngine(FlightStore& store, const FlightEngineSetup& setup, const FlightEngineOptions& options = {});
  ~FlightEngine();
  FlightEngine(const FlightEngine&) = delete;
  FlightEngine& operator=(const FlightEngine&) = delete;

  // Processes frames until the store has no further one; returns how many, restored ones not counted. Throws
  // Interrupted when cancelled, within a frame too, and Error when it cannot go on (with the event processing_blocked);
  // both leave the flight as it was after the last complete frame, and process() may be called again.
  std::size_t process(const Cancel& cancel = {}, const FrameListener& listener = {});

  // Places floating segments as wholes (segment_placer.hpp), for about so long. Of a flight that goes on only those
  // that no further frame can continue. True: there is more to do. Where one was merged, refined estimates of all
  // frames so far are stored. Throws Interrupted when cancelled, and may be called again then.
  bool place_segments(SegmentPlacer::Scope scope, double seconds, const Cancel& cancel = {});

  // Smooths the whole flight, and stores its refined estimates. Again after further pictures.
  void complete();

  // Of all frames that were processed (Localizer); of merged segments as they were placed.
  std::vector<Estimate> refined();
  std::vector<std::optional<FramePose>> refined_poses();
  std::vector<SmoothedFrame> smoothed();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace nadir
