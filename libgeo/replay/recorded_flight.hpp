// Flights and the flight recorder: a replay that is recorded, and a recorded flight that is read for a replay.
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

// Records a replay. Its clock is that of the current frame, so that the same replay gives the same recording.
class ReplayRecording {
 public:
  ReplayRecording(const std::filesystem::path& folder, SessionRecord session, bool keep_images);

  void before(std::uint64_t index, const Telemetry& telemetry, const std::filesystem::path& image);
  void after(std::uint64_t index, const FrameReport& report);
  // Throws Error when something could not be written.
  void close();

 private:
  std::filesystem::path folder_;
  std::atomic<std::uint64_t> now_ns_{0};
  Recorder recorder_;
};

// An anchor that arrived after other frames had been tracked.
struct LateAnchor {
  std::uint64_t index = 0;
  std::uint64_t taken_after = 0;
  bool looked = true;  // false: matching itself failed
};

// What the localizer received between two frames.
using BetweenFrames = std::variant<LateAnchor, HintRecord>;

// A flight as it was recorded.
struct RecordedFlight {
  Flight flight;  // its images are in frames_folder
  SessionRecord session;
  std::vector<EstimateRecord> estimates;
  std::vector<BetweenFrames> between;  // in the order of arrival
  std::uint64_t missing_between = 0;   // anchors and hints that the recording lost
  std::vector<FixRecord> fixes;
  std::vector<FixInputRecord> fix_inputs;
  std::size_t unusable_inputs = 0;   // those after a missing one
  std::uint64_t first_input_ns = 0;  // since 1970, UTC: when its first frame was recorded
};

struct RecordedFlightSource {
  std::filesystem::path recording;
  std::optional<std::string> session;           // its id; optional when there is only one
  std::optional<std::filesystem::path> frames;  // folder of the images; else those in the recording
  std::filesystem::path unpacked;               // folder for images out of the recording
};

// Rejects: several sessions and none chosen, no inputs, images that are missing or not those of the flight.
RecordedFlight read_recorded_flight(const RecordedFlightSource& source);

// How many of the recorded estimates came out the same in every bit (their latency aside), and the first that did not.
struct Reproduction {
  std::size_t compared = 0, same = 0;
  std::optional<std::string> first_other;  // the frame's name
};
Reproduction compare_estimates(const std::vector<EstimateRecord>& recorded, const std::vector<EstimateRecord>& flown);

}  // namespace nadir
