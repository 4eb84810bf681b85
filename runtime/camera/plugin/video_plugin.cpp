// The plug-in nadir_camera_video: recordings, cameras of this computer and of the network through OpenCV's videoio. The
// only place of the runtime that links it.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/videoio.hpp>
#include <string>
#include <string_view>

#include "camera/plugin_abi.h"

namespace {

// Timeouts of a network camera, shorter than the limit of the camera thread.
constexpr int kOpenTimeout_ms = 4000, kReadTimeout_ms = 3000;

// By default FFmpeg analyses a network stream for five seconds before it delivers a frame, and then delivers its
// buffer. The localizer needs the current frame.
constexpr const char* kLive =
    "rtsp_transport;tcp|analyzeduration;500000|fpsprobesize;0|fflags;nobuffer|flags;low_delay";

struct Video {
  cv::VideoCapture capture;
  cv::Mat frame;
  bool recording = false;
  double media_time_s = -1;  // of the last frame
};

void set_error(std::string_view what, char* error, size_t size) {
  if (size == 0) return;
  const size_t length = std::min(what.size(), size - 1);
  std::memcpy(error, what.data(), length);
  error[length] = '\0';
}

// OpenCV has no other access to FFmpeg's options, and reads them while it opens. An existing setting has precedence.
class LiveOptions {
 public:
  LiveOptions() : ours_(std::getenv(kName) == nullptr) {  // NOLINT(concurrency-mt-unsafe)
    if (ours_) ::setenv(kName, kLive, 1);                 // NOLINT(concurrency-mt-unsafe)
  }
  ~LiveOptions() {
    if (ours_) ::unsetenv(kName);  // NOLINT(concurrency-mt-unsafe): a recording is studied as ever
  }
  LiveOptions(const LiveOptions&) = delete;
  LiveOptions& operator=(const LiveOptions&) = delete;

 private:
  static constexpr const char* kName = "OPENCV_FFMPEG_CAPTURE_OPTIONS";
  bool ours_;
};

// A camera that is missing is tried again for the whole flight, and OpenCV would write lines to the log for each try.
// Whoever wants them sets OPENCV_LOG_LEVEL.
void be_quiet() {
  if (std::getenv("OPENCV_LOG_LEVEL") == nullptr)  // NOLINT(concurrency-mt-unsafe)
    cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
}

std::unique_ptr<Video> open_video(std::string_view source) {
  be_quiet();
  auto video = std::make_unique<Video>();
  if (source.starts_with("rtsp:")) {
    const LiveOptions options;
    video->capture.open(
        std::string(source), cv::CAP_FFMPEG,
        {cv::CAP_PROP_OPEN_TIMEOUT_MSEC, kOpenTimeout_ms, cv::CAP_PROP_READ_TIMEOUT_MSEC, kReadTimeout_ms});
  } else if (source.starts_with("v4l2:")) {
    video->capture.open(std::string(source.substr(5)), cv::CAP_V4L2);
    video->capture.set(cv::CAP_PROP_BUFFERSIZE, 1);  // the latest frame, not the oldest buffered one
  } else if (source.starts_with("video:")) {
    video->capture.open(std::string(source.substr(6)));
    video->recording = true;
  }
  return video->capture.isOpened() ? std::move(video) : nullptr;
}

// Of the frame that was just read. Containers without times: from the frame rate.
double media_time_s(Video& video) {
  const double reported_s = video.capture.get(cv::CAP_PROP_POS_MSEC) / 1000;
  if (std::isfinite(reported_s) && reported_s > video.media_time_s && reported_s >= 0) return reported_s;
  if (video.media_time_s < 0) return 0;
  const double fps = video.capture.get(cv::CAP_PROP_FPS);
  return video.media_time_s + 1 / (fps > 0 ? fps : 25);
}

void* open_camera(const char* source, char* error, size_t error_size) {
  try {
    auto video = open_video(source);
    if (!video) set_error("OpenCV cannot open it", error, error_size);
    return video.release();
  } catch (const std::exception& caught) {
    set_error(caught.what(), error, error_size);
    return nullptr;
  }
}

int32_t read_camera(void* camera, int32_t, NadirPluginFrame* frame, char* error, size_t error_size) {
  Video& video = *static_cast<Video*>(camera);
  try {
    if (!video.capture.read(video.frame) || video.frame.empty()) {
      if (video.recording) return NADIR_CAMERA_ENDED;
      set_error("no more frames", error, error_size);
      return NADIR_CAMERA_TROUBLE;
    }
    const int channels = video.frame.channels();
    if (video.frame.depth() != CV_8U || (channels != 1 && channels != 3)) {
      set_error("unsupported pixel format", error, error_size);
      return NADIR_CAMERA_TROUBLE;
    }
    if (!video.frame.isContinuous()) video.frame = video.frame.clone();
    if (video.recording) video.media_time_s = media_time_s(video);
    *frame = {video.frame.data,
              video.frame.total() * video.frame.elemSize(),
              video.frame.cols,
              video.frame.rows,
              channels,
              video.media_time_s,
              -1};
    return NADIR_CAMERA_FRAME;
  } catch (const std::exception& caught) {
    set_error(caught.what(), error, error_size);
    return NADIR_CAMERA_TROUBLE;
  }
}

void close_camera(void* camera) { delete static_cast<Video*>(camera); }

constexpr NadirCameraPlugin kPlugin{NADIR_CAMERA_PLUGIN_VERSION, "video", open_camera, read_camera, close_camera};

}  // namespace

extern "C" const NadirCameraPlugin* nadir_camera_plugin() { return &kPlugin; }
