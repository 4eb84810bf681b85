#include "replay/flight_folder.hpp"

#include <fmt/format.h>

#include <set>

#include "base/error.hpp"
#include "replay/pictures.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

std::set<std::string> pictures_in(const fs::path& folder) {
  std::error_code error;
  if (!fs::is_directory(folder, error)) {
    throw UsageError({.what = "the folder of frames cannot be read",
                      .where = folder.string(),
                      .expected = "a folder with pictures",
                      .found = fs::exists(folder, error) ? "no folder" : "nothing"});
  }
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.is_regular_file() && has_picture_extension(entry.path())) names.insert(entry.path().filename().string());
  }
  if (names.empty()) {
    throw UsageError({.what = "the folder of frames holds no picture",
                      .where = folder.string(),
                      .expected = "files ending in .jpg, .jpeg or .png"});
  }
  return names;
}

void check_size(const fs::path& path, const CameraModel& camera, const fs::path& camera_path) {
  const PictureSize size = read_picture_size(path);
  if (size.width == camera.width && size.height == camera.height) return;
  throw UsageError(
      {.what = "the picture does not come from this camera",
       .where = path.string(),
       .expected = fmt::format("{}×{} pixels as {} says", camera.width, camera.height, camera_path.string()),
       .found = fmt::format("{}×{} pixels", size.width, size.height),
       .fix = "give the camera file of these pictures; scale width, height, fx, fy, cx and cy if they were resampled"});
}

}  // namespace

Flight read_flight(const FlightPaths& paths) {
  Flight flight;
  flight.frames_folder = paths.frames;
  flight.camera = read_camera_file(paths.camera);
  flight.frames = read_telemetry(paths.telemetry);
  const std::set<std::string> pictures = pictures_in(paths.frames);
  for (const Telemetry& row : flight.frames) {
    if (!pictures.contains(row.frame)) {
      throw UsageError({.what = fmt::format("the telemetry names a frame that is not there: {}", row.frame),
                        .where = paths.telemetry.string(),
                        .expected = fmt::format("a picture of that name in {}", paths.frames.string()),
                        .fix = "remove the row, or give the folder that belongs to this telemetry"});
    }
    check_size(paths.frames / row.frame, flight.camera.camera, paths.camera);
  }
  flight.pictures_without_row = pictures.size() - flight.frames.size();
  return flight;
}

}  // namespace nadir
