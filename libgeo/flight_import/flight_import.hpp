// A flight as `nadir replay` reads it, out of what people have: photos, with or without a log of the autopilot, or a
// recording of our own.
//
//   photos          time, height and attitude from EXIF and XMP
//   photos + log    the clock offset between camera and log, then height and attitude from the log (flight_log.hpp)
//   video (+ log)   a frame every so often, timed within the video
//   recording       frames, telemetry and camera as they were flown
//
// The folder that is written has frames/ (links or copies), telemetry.csv, camera.yaml and import.json, and with
// `truth` truth.csv. Sources are never changed.
//
// Everything that is not stated by the sources is either assumed, and then a finding of severity note or warning says
// what and which option states it, or missing, and then a finding of severity error asks for it by its option and
// nothing is written. Codes begin with "import." (docs/findings.md).
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/error.hpp"
#include "base/progress.hpp"
#include "flight_import/camera_draft.hpp"
#include "geodesy/lon_lat.hpp"
#include "vision/camera.hpp"

namespace nadir {

enum class FrameTransfer { link, copy };

struct ImportRequest {
  std::vector<std::filesystem::path> photos;       // folders or files
  std::optional<std::filesystem::path> video;      // instead of photos
  std::optional<std::filesystem::path> log;        // .BIN, .ulg, .tlog: recognised by their first bytes
  std::optional<std::filesystem::path> recording;  // of the flight recorder; photos: where it does not hold them
  std::optional<std::string> session;              // of the recording
  std::optional<std::filesystem::path> camera;     // a camera.yaml that is known already
  std::string model;                               // which camera's photos
  StatedLens lens;
  Attitude mount;                        // of the camera in the aircraft, as in an airframe file
  std::optional<double> agl_m;           // of all photos
  std::optional<double> ground_m;        // height of the ground above sea level
  std::optional<double> clock_offset_s;  // log time less camera time
  std::optional<double> zone_s;          // camera time less UTC
  std::optional<double> interval_s;      // between photos without a time, or frames that are taken of a video
  std::optional<LonLat> start;           // position of the first photo, roughly
  std::optional<LonLat> takeoff;
  bool truth = false;  // write truth.csv
  FrameTransfer transfer = FrameTransfer::link;
  // Height of the ground from an elevation model; looked up at recorded positions.
  std::function<std::optional<double>(LonLat)> ground_height_m;
};

struct ImportResult {
  Findings findings;                                         // errors: nothing was written
  std::vector<std::pair<std::string, std::string>> figures;  // what was found, for people
  std::size_t frames = 0;
  std::optional<double> clock_offset_s, clock_offset_sigma_s;
  std::string clock_offset_from;
  std::optional<LonLat> start;  // stated, or of the first photo's GPS when truth was asked for
};

// out: must not exist. Throws UsageError for sources that cannot be read at all.
ImportResult import_flight(const ImportRequest& request, const std::filesystem::path& out, Progress& progress);

}  // namespace nadir
