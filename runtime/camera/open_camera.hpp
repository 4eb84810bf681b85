// --camera SOURCE to the camera that it names.
//
//   FOLDER, folder:FOLDER   pictures that another program writes
//   video:FILE              a recording, at its own speed      ┐
//   v4l2:/dev/video0        a camera of this computer          │ through the plug-in nadir_camera_video.so
//   rtsp://…                a camera in the network            ┘
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "camera/camera_source.hpp"
#include "camera/folder_camera.hpp"
#include "service/clock.hpp"

namespace nadir {

// Where plug-ins are looked for: beside the program, and where it is installed (../lib/nadir).
std::vector<std::filesystem::path> plugin_folders();

// Throws UsageError for what names no camera, Error when the plug-in is missing.
std::unique_ptr<CameraSource> open_camera(const std::string& source, const FlightClock& clock,
                                          const std::vector<std::filesystem::path>& plugins = plugin_folders(),
                                          Backlog backlog = Backlog::skip);

}  // namespace nadir
