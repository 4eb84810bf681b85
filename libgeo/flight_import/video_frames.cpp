#include "flight_import/video_frames.hpp"

#include <dlfcn.h>
#include <fmt/format.h>

#include <array>
#include <cmath>
#include <memory>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/printable.hpp"
#include "camera/plugin_abi.h"

namespace nadir {
namespace {

constexpr const char* kVideoLibrary = "nadir_camera_video.so";
constexpr std::size_t kMostVideoFrames = 100'000;
constexpr int kVideoQuality = 95;

std::vector<std::filesystem::path> usual_plug_in_folders() {
  std::error_code error;
  const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe", error);
  if (error) return {};
  return {program.parent_path(), program.parent_path().parent_path() / "lib" / "nadir"};
}

struct CloseLibrary {
  void operator()(void* library) const { ::dlclose(library); }
};
using Library = std::unique_ptr<void, CloseLibrary>;

const NadirCameraPlugin* table_of(void* library) {
  using Entry = const NadirCameraPlugin* (*)();
  const auto entry = reinterpret_cast<Entry>(::dlsym(library, "nadir_camera_plugin"));
  const NadirCameraPlugin* table = entry == nullptr ? nullptr : entry();
  return table != nullptr && table->version == NADIR_CAMERA_PLUGIN_VERSION ? table : nullptr;
}

Library load_video_plug_in(std::vector<std::filesystem::path> folders) {
  if (folders.empty()) folders = usual_plug_in_folders();
  std::string looked;
  for (const auto& folder : folders) {
    Library library(::dlopen((folder / kVideoLibrary).c_str(), RTLD_NOW | RTLD_LOCAL));
    if (library && table_of(library.get()) != nullptr) return library;
    looked += (looked.empty() ? "" : ", ") + folder.string();
  }
  throw UsageError({.what = "videos cannot be read here",
                    .where = kVideoLibrary,
                    .expected = "the plug-in of this version in " + looked,
                    .found = "none",
                    .fix =
                        "install libopencv-videoio-dev and build Nadir again, or unpack the video: ffmpeg -i VIDEO -vf "
                        "fps=1 -q:v 2 photos/%06d.jpg, and import these with --interval-s 1"});
}

std::string text_of(std::array<char, 256>& error) {
  error.back() = '\0';
  return error.front() == '\0' ? "no reason given" : printable(error.data());
}

}  // namespace

VideoFrames unpack_video(const VideoSource& source, const std::filesystem::path& folder, Progress& progress) {
  if (!std::filesystem::is_regular_file(source.file)) {
    throw UsageError({.what = "cannot read the video",
                      .where = source.file.string(),
                      .expected = "a video file",
                      .found = std::filesystem::exists(source.file) ? "something else" : "nothing"});
  }
  const Library library = load_video_plug_in(source.plug_ins);
  const NadirCameraPlugin& plug_in = *table_of(library.get());
  std::array<char, 256> error{};
  const std::unique_ptr<void, void (*)(void*)> video(
      plug_in.open(("video:" + source.file.string()).c_str(), error.data(), error.size()), plug_in.close);
  const auto refuse = [&source](std::string found) {
    throw UsageError({.what = "cannot read the video",
                      .where = source.file.string(),
                      .expected = "a video that OpenCV reads",
                      .found = std::move(found)});
  };
  if (!video) refuse(text_of(error));
  VideoFrames result;
  const std::string stem = printable(source.file.stem().string());
  progress.begin("unpacking the video", 0, "frames");
  for (;;) {
    NadirPluginFrame frame{};
    const std::int32_t status = plug_in.read(video.get(), 1000, &frame, error.data(), error.size());
    if (status == NADIR_CAMERA_ENDED) break;
    if (status == NADIR_CAMERA_NOTHING) continue;
    if (status != NADIR_CAMERA_FRAME) refuse(text_of(error));
    // What the plug-in says is not trusted.
    const bool sound = frame.data != nullptr && frame.width > 0 && frame.height > 0 && frame.width <= kMaxImageSide &&
                       frame.height <= kMaxImageSide && (frame.channels == 1 || frame.channels == 3) &&
                       std::isfinite(frame.media_time_s) && frame.media_time_s >= 0 && frame.media_time_s < 1e6;
    if (!sound) refuse("a frame of an impossible size or time");
    progress.advance();
    if (!result.frames.empty() && frame.media_time_s < result.frames.back().time_s + source.interval_s - 1e-6) continue;
    const FrameSize size{frame.width, frame.height};
    if (result.frames.empty()) result.size = size;
    if (size.width != result.size.width || size.height != result.size.height) refuse("frames of different sizes");
    if (result.frames.size() >= kMostVideoFrames) refuse("more frames than one flight has: choose a longer interval");
    const cv::Mat pixels(frame.height, frame.width, frame.channels == 1 ? CV_8UC1 : CV_8UC3,
                         const_cast<std::uint8_t*>(frame.data));  // NOLINT: cv::Mat's interface; nothing writes to it
    VideoFrame taken{fmt::format("{}_{:08}.jpg", stem, std::llround(frame.media_time_s * 1e3)), frame.media_time_s};
    for (char& c : taken.name) {
      if (c == '"' || c == ',') c = '_';
    }
    write_file_atomic(folder / taken.name, ByteView(encode_image(pixels, ImageFormat::jpeg, kVideoQuality)));
    result.frames.push_back(std::move(taken));
  }
  progress.end();
  if (result.frames.empty()) refuse("no frames");
  return result;
}

}  // namespace nadir
