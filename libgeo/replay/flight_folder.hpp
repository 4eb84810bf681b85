// A recorded flight as `nadir replay` reads it: frames (images) in a folder, one row of telemetry for each, the camera.
//
// Strict: everything that would silently change the meaning of the result is a UsageError before the first image is
// decoded (docs/formats.md describes the files).
#pragma once

#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "estimation/telemetry.hpp"
#include "vision/camera.hpp"

namespace nadir {

class CsvTable;

struct Flight {
  CameraFile camera;
  std::filesystem::path frames_folder;
  std::vector<Telemetry> frames;       // in order of time
  std::size_t images_without_row = 0;  // ignored: they have no telemetry
  std::vector<std::string> files;      // names of the images, where they differ from those of the frames

  std::filesystem::path image_path(std::size_t frame) const {
    return frames_folder / (files.empty() ? frames[frame].frame : files[frame]);
  }
};

struct FlightPaths {
  std::filesystem::path frames;
  std::filesystem::path telemetry;  // and imu.csv beside it, if it exists
  std::filesystem::path camera;
};

// Rejects: an empty table or folder, rows out of time order, a frame named twice or missing, NaN, angles and heights
// out of range, images of another size than the camera's.
Flight read_flight(const FlightPaths& paths);

// The table alone (frames' names are checked for form, not for existence).
std::vector<Telemetry> read_telemetry(const std::filesystem::path& path);
std::vector<Telemetry> read_telemetry(const CsvTable& table);

// CV_8UC1 of the file's size divided by `shrink` (1, 2, 4, 8); empty when the file is damaged: the localizer then
// rejects the frame.
cv::Mat read_grey_image(const std::filesystem::path& path, int shrink = 1);

// Decoded as in flight (decode_camera_frame()); `camera` is that of the decoded image. Empty also when the size does
// not match.
cv::Mat read_flight_image(const std::filesystem::path& path, const CameraModel& camera, int shrink);

}  // namespace nadir
