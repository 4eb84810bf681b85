// A recorded flight on the page that was watched in flight: the same view, event list and API, fed by the recording.
//
//   recording ──records of one session──► Playback ──FlightView──► API, page, `nadir watch`
//                                            ▲
//                       play, pause, speed, moment: POST /v1/playback
//
// Time is the recording's. A moment is a number of view periods (0.2 s, as in flight) since its first record, and its
// view is what the records up to it give, one view period after the other. So it is the same however it was reached:
// a later moment goes on from the present one, an earlier one begins anew (an hour of flight takes about 0.1 s). After
// each jump the view has another boot_id, by which readers know that what they showed is no longer what happened.
//
// A clock that was set in flight, and pauses of the recording, are passed over: no two records are more than a minute
// apart, and none is before the last one. UTC is that of the records.
//
// What was not recorded is not known: of the autopilot whether it sends attitudes, but no counts of its frames; of
// frames how many were processed, not how many were dropped; of a state the reason as of its beginning; no protection
// level while the aircraft was blind. A recording of a replay has no states of a service: they follow from whether
// there is a position.
//
// The recording is only read, and nothing else is started: no link, no camera, no recorder, no tiles.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>

#include "api/api.hpp"
#include "base/progress.hpp"
#include "flight/optional_parts.hpp"
#include "service/clock.hpp"

namespace nadir {

struct PlaybackSource {
  std::filesystem::path recording{};               // a folder of the recorder, or one of its files
  std::optional<std::string> session{};            // its id; nullopt: the newest
  std::optional<std::filesystem::path> package{};  // the map below the flight; nullopt: none
};

class Playback {
 public:
  // run: letters and digits that differ between runs of the program. Throws Error, and UsageError for a recording
  // without that session or without estimates, and for a package that is not the one that was flown.
  Playback(const PlaybackSource& source, std::string run, Progress& progress);
  ~Playback();
  Playback(const Playback&) = delete;
  Playback& operator=(const Playback&) = delete;

  // What is to be shown from the next advance() on. From any thread; within length_s.
  PlaybackView control(const PlaybackRequest& request);

  // So many seconds have passed for the one who watches: moves on while it plays, and pauses at the end.
  void advance(double elapsed_s);

  // As of the last advance().
  FlightView view() const;
  const std::string& notice() const { return control_.notice; }  // what could not be read

  ApiPackage for_api() const;

 private:
  struct Recorded;  // what was read
  class Moment;     // the flight up to a moment

  bool at_end() const { return control_.at_s >= control_.length_s; }

  const std::string run_;
  std::unique_ptr<const Recorded> recorded_;
  std::unique_ptr<Moment> moment_;
  std::uint64_t jumps_ = 0;
  double position_s_ = 0;  // between view periods

  mutable std::mutex mutex_;
  PlaybackView control_;  // what is wanted; session, dates and notice never change
  bool sought_ = false;   // and has not been reached
};

// Serves page and API until stop is requested. Throws as HttpServer and OptionalParts do for the endpoint.
// on_listening: with the port.
void serve_playback(Playback& playback, const ApiEndpoint& endpoint, const FlightClock& clock,
                    const std::stop_token& stop, const std::function<void(std::uint16_t port)>& on_listening);

}  // namespace nadir
