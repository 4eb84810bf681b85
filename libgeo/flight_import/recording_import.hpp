// A recording of the flight recorder as an imported flight: frames, telemetry and camera as they were flown.
//
// Names in a recording may be anything, and images may be missing; the folder that comes out has plain names and the
// frames that have one. The intervals of a frame's telemetry are summed up, because telemetry.csv has one change of
// velocity per frame.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "base/error.hpp"
#include "flight_import/imported_flight.hpp"
#include "replay/recorded_flight.hpp"

namespace nadir {

struct ImportedRecording {
  std::vector<ImportedFrame> frames;
  std::vector<InertialSample> inertial;
  std::string camera_yaml;
  std::optional<LonLat> start;
  std::string text;  // what it is, for people
  Findings findings;
};

// truth: with the receiver's positions. Throws UsageError as read_recorded_flight().
ImportedRecording import_recording(const RecordedFlightSource& source, bool truth);

}  // namespace nadir
