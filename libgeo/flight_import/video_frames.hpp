// A video as photos: every so often a frame, written as JPEG. Its time is that within the video, which starts at zero.
//
// Video is decoded by the plug-in nadir_camera_video (runtime/camera/plugin_abi.h), which is loaded here alone and only
// when there is a video: no program links a video library.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "base/progress.hpp"
#include "imagery/frame_image.hpp"

namespace nadir {

struct VideoFrame {
  std::string name;  // of the file in the folder: "flight_00012500.jpg", with its time in milliseconds
  double time_s = 0;
};

struct VideoFrames {
  std::vector<VideoFrame> frames;
  FrameSize size;
};

struct VideoSource {
  std::filesystem::path file;
  double interval_s = 1;                             // between the frames that are taken, at least
  std::vector<std::filesystem::path> plug_ins = {};  // folders to look in; empty: the program's own and ../lib/nadir
};

// Throws UsageError for a file that is no video, or when the plug-in is not installed.
VideoFrames unpack_video(const VideoSource& source, const std::filesystem::path& folder, Progress& progress);

}  // namespace nadir
