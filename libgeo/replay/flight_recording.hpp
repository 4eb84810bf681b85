// A replay into the flight recorder, and a flight out of one.
#pragma once

#include <atomic>
#include <filesystem>
#include <optional>
#include <variant>
#include <vector>

#include "recorder/recorder.hpp"
#include "replay/flight_folder.hpp"

namespace nadir {

struct ReplaySetup;

// Records a replay. Time stands at the frame that is flown, so that the same replay gives the same recording.
class ReplayRecording {
 public:
  ReplayRecording(const std::filesystem::path& folder, SessionRecord session, bool keep_pictures);

  void before(std::uint64_t index, const Telemetry& told, const std::filesystem::path& picture);
  void after(std::uint64_t index, const FrameReport& report);
  // Throws Error when something could not be written: a replay has no flight to go on with.
  void close();

 private:
  std::filesystem::path folder_;
  std::atomic<std::uint64_t> now_ns_{0};
  Recorder recorder_;
};

// An anchor that was taken in after other frames had been followed.
struct LateAnchor {
  std::uint64_t index = 0;
  std::uint64_t taken_after = 0;
  bool looked = true;  // false: the look itself failed
};

// What the localizer was told between two frames.
using BetweenFrames = std::variant<LateAnchor, HintRecord>;

// A flight as it was recorded.
struct RecordedFlight {
  Flight flight;  // its pictures are looked for in frames_folder
  SessionRecord session;
  std::vector<EstimateRecord> estimates;
  std::vector<BetweenFrames> between;  // in the order in which it was told
  std::size_t unusable_inputs = 0;     // after one that is missing
  std::uint64_t first_input_ns = 0;    // since 1970, UTC: when its first frame was recorded
};

struct RecordedFlightSource {
  std::filesystem::path recording;
  std::optional<std::string> session;           // its id; may be left out when there is one
  std::optional<std::filesystem::path> frames;  // where the pictures are; else those in the recording
  std::filesystem::path unpacked;               // a folder for pictures out of the recording
};

// The session that is meant: `asked`, or the only one. Throws UsageError when that is not clear.
std::string chosen_session(const std::filesystem::path& recording, const std::optional<std::string>& asked);

// Refuses: several sessions and none chosen, no inputs, pictures that are missing or are not those of the flight.
RecordedFlight read_recorded_flight(const RecordedFlightSource& source);

// How many of the recorded estimates came out the same in every bit (their latency aside), and the first that did not.
struct Reproduction {
  std::size_t compared = 0, same = 0;
  std::optional<std::string> first_other;  // the frame's name
};
Reproduction compare_estimates(const std::vector<EstimateRecord>& recorded, const std::vector<EstimateRecord>& flown);

}  // namespace nadir
