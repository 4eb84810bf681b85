// A plug-in for the tests: what it does follows from the source's name.
#include <cmath>
#include <cstring>
#include <string_view>
#include <vector>

#include "camera/plugin_abi.h"

namespace {

// Two rows of three pixels, three bytes each.
struct Camera {
  std::string_view kind;
  int reads = 0;
  std::vector<uint8_t> data;
};

int opened = 0;

void say(const char* what, char* error, size_t size) { std::strncpy(error, what, size); }

void* open_camera(const char* source, char* error, size_t error_size) {
  ++opened;
  for (const char* kind : {"rtsp:live", "rtsp:drops", "rtsp:false-size", "rtsp:huge", "rtsp:none", "rtsp:stamped",
                           "rtsp:false-age", "video:recording"}) {
    if (source == std::string_view(kind)) return new Camera{kind, 0, std::vector<uint8_t>(18, 7)};
  }
  if (source == std::string_view("rtsp:late") && opened > 2)
    return new Camera{"rtsp:live", 0, std::vector<uint8_t>(18, 7)};
  // As a library does that knows nothing of secrets.
  say(std::string_view(source).find('@') == std::string_view::npos ? "no such camera" : source, error, error_size);
  return nullptr;
}

int32_t read_camera(void* opaque, int32_t, NadirPluginFrame* frame, char* error, size_t error_size) {
  auto& camera = *static_cast<Camera*>(opaque);
  const int read = camera.reads++;
  *frame = {camera.data.data(), camera.data.size(), 3, 2, 3, -1, -1};
  if (camera.kind == "rtsp:none") return NADIR_CAMERA_NOTHING;
  if (camera.kind == "rtsp:false-size") frame->width = 3000;
  if (camera.kind == "rtsp:stamped") frame->age_s = 0.04 * read;
  if (camera.kind == "rtsp:false-age") frame->age_s = std::nan("");
  if (camera.kind == "rtsp:huge") frame->width = frame->height = 2'000'000'000;
  if (camera.kind == "rtsp:drops" && read == 1) {
    say("the network is gone", error, error_size);
    return NADIR_CAMERA_TROUBLE;
  }
  if (camera.kind == "video:recording") {
    frame->media_time_s = 10 + 0.5 * read;  // a recording that does not begin at zero
    if (read == 3) return NADIR_CAMERA_ENDED;
  }
  return NADIR_CAMERA_FRAME;
}

void close_camera(void* camera) { delete static_cast<Camera*>(camera); }

#ifndef FAKE_PLUGIN_VERSION
#define FAKE_PLUGIN_VERSION NADIR_CAMERA_PLUGIN_VERSION
#endif
constexpr NadirCameraPlugin kPlugin{FAKE_PLUGIN_VERSION, "fake", open_camera, read_camera, close_camera};

}  // namespace

extern "C" const NadirCameraPlugin* nadir_camera_plugin() { return &kPlugin; }
