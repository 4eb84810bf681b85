// Recorder, API and candidate tiles: what a flight has besides its position. A missing folder, a taken port or a wrong
// key ends no flight: whatever could not be started is reported, tried again in flight, and reported when it works
// (service/retried_part.hpp).
//
//   part              does its work on        others give it                          without it
//   recorder          a thread of its own     records, from every thread, queued      no evidence of the flight
//   API               the server's threads    the view, from the conductor            no page, no hints through it
//   candidate tiles   a thread of its own     frames and anchors, from the tracker    no tiles for the next map
//
// Parts are started by one thread at a time: the caller's before the first frame, the upkeep thread (upkeep.hpp) in
// flight. All other threads see a part as a pointer, which is null until the part is there and then valid until
// close().
//
// Beside the tiles lies a signed report of the package that is flown (trust/installed_report.hpp), unless the package
// was resumed. Hints through an API without a token need the one in STATE/api-token, which is made here.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <utility>

#include "api/api.hpp"
#include "base/error.hpp"
#include "flight/localization_thread.hpp"
#include "flight/mission_map.hpp"
#include "flight/tile_making.hpp"
#include "recorder/recorder.hpp"
#include "service/clock.hpp"
#include "service/onboard_event.hpp"
#include "service/retried_part.hpp"
#include "vision/camera.hpp"

namespace nadir {

struct RecordingOptions {
  std::optional<std::filesystem::path> folder;  // nullopt: no recording
  bool keep_pictures = false;
};

struct ApiEndpoint {
  std::string address = "127.0.0.1:8750";
  // File with the bearer token. nullopt: on loopback everybody may read, and hints need a token that is made in the
  // state folder.
  std::optional<std::filesystem::path> token;
};

struct CandidateOptions {
  std::optional<std::filesystem::path> folder;    // nullopt: no tiles are made
  std::optional<std::filesystem::path> tile_key;  // signs them; without a folder: the key was not accepted
  std::int64_t budget_mb = 2000;                  // on disk
  int percent = 25;                               // of one core, for the tiles
  int frame_ms = 0;                               // for the tiles of one frame; 0: no limit
};

struct OptionalPartsSetup {
  RecordingOptions recording;
  ApiEndpoint api;
  CandidateOptions candidates;
  std::filesystem::path state;                    // folder
  Airframe airframe;                              // as it is flown
  const MissionMap* map = nullptr;                // null: the package was rejected, and no tiles are made
  std::optional<LocalizationSetup> localization;  // what the localizer starts from; with a map
  Findings findings;                              // of the package's verification
  std::int64_t root_version = 0;                  // of the root that verified it; 0: resumed, not verified now
};

class OptionalParts {
 public:
  using Publish = std::function<void(OnboardEvent)>;  // from any thread

  // Starts nothing. Throws UsageError for an address of the API that is none, or that requires a token. The map, the
  // clock and what `publish` uses must outlive this.
  OptionalParts(OptionalPartsSetup setup, const FlightClock& clock, Publish publish);
  ~OptionalParts() = default;  // without close() the recording has no clean end
  OptionalParts(const OptionalParts&) = delete;
  OptionalParts& operator=(const OptionalParts&) = delete;

  // Each part that is wanted, not there yet, and due. now_s: monotonic.
  void start_missing(double now_s);

  // The orderly end. The threads that give something to the parts, and the one that starts them, have ended.
  void close();

  Recorder* recorder() const { return recorder_; }  // from any thread, null: not there yet
  TileMaking* tiles() const { return tiles_; }      // likewise

  // The conductor's end of the API, whether or not it is there.
  void show(FlightView view) { board_.publish(std::move(view)); }
  std::unique_ptr<Hint> take_hint() { return hints_.take(); }

 private:
  // Throw what hinders.
  void start_recorder();
  void start_api();
  void start_tiles();
  void report_installed_package(const TileMakingSetup& making);

  const OptionalPartsSetup setup_;
  const ListenAddress address_;  // of the API
  const FlightClock& clock_;
  const Publish publish_;

  struct Retries {
    RetriedPart recorder{"recorder"}, api{"API"}, tiles{"candidate tiles"};  // of the thread that starts the parts
    RetriedPart making{"candidate tiles"};                                   // of the tiles' own thread
  } retries_;

  FlightBoard board_;
  LatestSlot<Hint> hints_;
  // Destroyed from the last one: the tiles' thread still records what it finishes.
  std::unique_ptr<Recorder> recorder_owner_;
  std::atomic<Recorder*> recorder_{nullptr};
  std::unique_ptr<Api> api_;
  std::unique_ptr<HttpServer> server_;
  std::unique_ptr<TileMaking> tiles_owner_;
  std::atomic<TileMaking*> tiles_{nullptr};
};

}  // namespace nadir
