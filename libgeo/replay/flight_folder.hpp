// A recorded flight as `nadir replay` reads it: pictures in a folder, one row of telemetry for each, the camera.
//
// Strict: everything that would make the result mean something else than the user thinks is a UsageError before the
// first picture is decoded (docs/formats.md has the form of the files).
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "estimation/telemetry.hpp"
#include "vision/camera.hpp"

namespace nadir {

struct Flight {
  CameraFile camera;
  std::filesystem::path frames_folder;
  std::vector<Telemetry> frames;         // in time
  std::size_t pictures_without_row = 0;  // left out: they have no telemetry
  std::vector<std::string> files;        // of the frames, where they are not called as the frames are

  std::filesystem::path picture(std::size_t frame) const {
    return frames_folder / (files.empty() ? frames[frame].frame : files[frame]);
  }
};

struct FlightPaths {
  std::filesystem::path frames;
  std::filesystem::path telemetry;
  std::filesystem::path camera;
};

// Refuses: an empty table or folder, rows out of time order, a frame named twice or not there, NaN, angles and heights
// that cannot be, pictures of another size than the camera's.
Flight read_flight(const FlightPaths& paths);

// The table alone (frames' names are checked for form, not for existence).
std::vector<Telemetry> read_telemetry(const std::filesystem::path& path);

}  // namespace nadir
