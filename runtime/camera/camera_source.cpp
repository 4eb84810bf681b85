#include "camera/camera_source.hpp"

#include "base/error.hpp"
#include "camera/folder_camera.hpp"
#include "camera/plugin_camera.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

constexpr const char* kVideoPlugin = "nadir_camera_video.so";

fs::path find_plugin(const std::string& name, const std::vector<fs::path>& folders) {
  std::string searched;
  for (const fs::path& folder : folders) {
    if (fs::exists(folder / name)) return folder / name;
    searched += (searched.empty() ? "" : ", ") + folder.string();
  }
  throw Error({.what = "camera plug-in not installed",
               .where = name,
               .expected = "in one of: " + searched,
               .fix = "build it where OpenCV's videoio is installed (libopencv-videoio-dev), or use a folder as the "
                      "camera"});
}

}  // namespace

std::vector<fs::path> plugin_folders() {
  std::error_code error;
  const fs::path program = fs::read_symlink("/proc/self/exe", error);
  if (error) return {};
  return {program.parent_path(), program.parent_path().parent_path() / "lib" / "nadir"};
}

std::unique_ptr<CameraSource> open_camera(const std::string& source, const FlightClock& clock,
                                          const std::vector<fs::path>& plugins, Backlog backlog) {
  const auto after = [&](std::string_view kind) { return source.substr(kind.size()); };
  if (source.starts_with("folder:")) return std::make_unique<FolderCamera>(after("folder:"), clock, backlog);
  if (source.starts_with("video:") || source.starts_with("v4l2:") || source.starts_with("rtsp:")) {
    return std::make_unique<PluginCamera>(find_plugin(kVideoPlugin, plugins), source, clock);
  }
  if (source.empty() || (source.find(':') != std::string::npos && !fs::is_directory(source))) {
    throw UsageError({.what = "unknown kind of camera",
                      .where = "--camera",
                      .expected = "a folder, video:FILE, v4l2:DEVICE or rtsp://ADDRESS",
                      .found = source});
  }
  return std::make_unique<FolderCamera>(source, clock, backlog);
}

}  // namespace nadir
