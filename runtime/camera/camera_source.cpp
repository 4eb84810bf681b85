#include "camera/camera_source.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "base/error.hpp"
#include "base/files.hpp"
#include "camera/folder_camera.hpp"
#include "camera/plugin_camera.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

// What reads which kinds of sources.
struct KnownPlugin {
  const char* file;
  std::vector<std::string_view> kinds;
  const char* needs;
};

const std::vector<KnownPlugin>& known_plugins() {
  static const std::vector<KnownPlugin> all = {
      {"nadir_camera_video.so", {"video:", "v4l2:", "rtsp:"}, "OpenCV's videoio is installed (libopencv-videoio-dev)"},
      {"nadir_camera_gstreamer.so", {"gstreamer:"}, "GStreamer is installed (libgstreamer1.0-dev)"},
  };
  return all;
}

fs::path find_plugin(const KnownPlugin& plugin, const std::vector<fs::path>& folders) {
  std::string searched;
  for (const fs::path& folder : folders) {
    if (fs::exists(folder / plugin.file)) return folder / plugin.file;
    searched += (searched.empty() ? "" : ", ") + folder.string();
  }
  throw Error({.what = "camera plug-in not installed",
               .where = plugin.file,
               .expected = "in one of: " + searched,
               .fix = fmt::format("build it where {}, or use a folder as the camera", plugin.needs)});
}

}  // namespace

namespace {

struct Authority {  // of a URL: where it begins and ends, and the '@' in it, npos without
  std::size_t begin = 0, end = 0, at = std::string::npos;
};

std::optional<Authority> authority_of(const std::string& source) {
  const std::size_t scheme = source.find("://");
  if (scheme == std::string::npos) return std::nullopt;
  Authority found{.begin = scheme + 3};
  found.end = std::min(source.find_first_of("/?#", found.begin), source.size());
  // A password may contain an unescaped slash: everything up to the last '@' is secret.
  const std::size_t at = source.rfind('@');
  if (at != std::string::npos && at >= found.begin) found.at = at;
  return found;
}

constexpr std::uint64_t kMaxCredentials = 1024;

std::string escaped(const std::string& text) {
  constexpr std::string_view kPlain = "-._~";
  std::string result;
  for (const char c : text) {
    const bool plain = (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
                       kPlain.find(c) != std::string_view::npos;
    if (plain) {
      result += c;
      continue;
    }
    constexpr const char* kDigits = "0123456789ABCDEF";
    const auto byte = static_cast<unsigned char>(c);
    result += {'%', kDigits[byte >> 4U], kDigits[byte & 15U]};
  }
  return result;
}

}  // namespace

std::string redacted(const std::string& source) {
  const auto authority = authority_of(source);
  if (!authority || authority->at == std::string::npos) return source;
  return source.substr(0, authority->begin) + source.substr(authority->at + 1);
}

std::string with_credentials(const std::string& source, const fs::path& file) {
  const auto authority = authority_of(source);
  if (!authority || authority->at != std::string::npos) {
    throw UsageError({.what = "the camera's credentials cannot be added to this source",
                      .where = "--camera",
                      .expected = "a network address without user and password, rtsp://HOST/…",
                      .found = redacted(source)});
  }
  require_private_mode(file);
  std::string text = read_text_file(file, kMaxCredentials);
  while (text.ends_with('\n') || text.ends_with('\r')) text.pop_back();
  const std::size_t colon = text.find(':');
  if (colon == 0 || colon == std::string::npos || text.find_first_of("\r\n") != std::string::npos) {
    throw UsageError({.what = "the file contains no credentials of a camera",
                      .where = file,
                      .expected = "one line, USER:PASSWORD",
                      .found = "other content (not shown: it may be a secret)"});
  }
  return source.substr(0, authority->begin) + escaped(text.substr(0, colon)) + ":" + escaped(text.substr(colon + 1)) +
         "@" + source.substr(authority->begin);
}

std::unique_ptr<CameraSource> open_camera(const std::string& source, const FlightClock& clock,
                                          const std::vector<fs::path>& plugins, Backlog backlog) {
  const auto after = [&](std::string_view kind) { return source.substr(kind.size()); };
  if (source.starts_with("folder:")) return std::make_unique<FolderCamera>(after("folder:"), clock, backlog);
  for (const KnownPlugin& plugin : known_plugins()) {
    const auto names = [&](std::string_view kind) { return source.starts_with(kind); };
    if (std::none_of(plugin.kinds.begin(), plugin.kinds.end(), names)) continue;
    return std::make_unique<PluginCamera>(find_plugin(plugin, plugins), source, clock);
  }
  if (source.empty() || (source.find(':') != std::string::npos && !fs::is_directory(source))) {
    throw UsageError(
        {.what = "unknown kind of camera",
         .where = "--camera",
         .expected = "a folder, video:FILE, v4l2:DEVICE, rtsp://ADDRESS, gstreamer:PIPELINE or mavlink:COMPONENT",
         .found = redacted(source)});
  }
  return std::make_unique<FolderCamera>(source, clock, backlog);
}

}  // namespace nadir
