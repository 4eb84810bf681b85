// A source of camera frames, and the ones that --camera names:
//
//   FOLDER, folder:FOLDER   images that another program writes
//   video:FILE              a recording, at its own speed      ┐
//   v4l2:/dev/video0        a camera of this computer          │ through the plug-in nadir_camera_video.so
//   rtsp://…                a network camera                   ┘
//   gstreamer:PIPELINE      whatever GStreamer reads, with the times of its stamps: through nadir_camera_gstreamer.so
//
// One thread reads a source and puts each frame into the localizer's mailbox. A source has no clock but the one that it
// is given, and no image library.
#pragma once

#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "base/bytes.hpp"
#include "base/platform.hpp"
#include "service/clock.hpp"

namespace nadir {

// Uncompressed pixels: rows from the top, without padding, 1 (grey) or 3 (BGR) bytes per pixel.
struct RawPixels {
  int width = 0;
  int height = 0;
  int channels = 3;
};

struct CameraFrame {
  std::string name;               // file name, or a sequence number
  double time_s = 0;              // monotonic, on arrival
  Bytes bytes;                    // an encoded image (JPEG, PNG, WebP, TIFF), or pixels
  std::optional<RawPixels> raw;   // the layout when bytes are pixels
  std::optional<double> age_s{};  // on arrival, since the exposure: of a camera that stamps its frames
};

enum class CameraStatus {
  frame,
  timeout,    // no frame within the time, or stop was requested
  bad_frame,  // one image is unusable; the next one may be there already
  failure,    // the camera is gone or delivers invalid images; it may recover: try again
  ended,      // no more frames: the end of a video
};

struct CameraReading {
  CameraStatus status = CameraStatus::timeout;
  CameraFrame frame{};   // with CameraStatus::frame
  std::string detail{};  // for the recorder, with failure and ended
};

class CameraSource {
 public:
  virtual ~CameraSource() = default;

  // Waits for the next frame, at most this long. Never throws for what a camera does in flight.
  virtual CameraReading next(std::chrono::milliseconds at_most, std::stop_token stop) = 0;

  virtual std::string describe() const = 0;  // "folder /data/frames"
};

// Images that are in the folder when it is opened. In flight they are stale.
enum class Backlog { skip, newest, all };

// Without user and password: "rtsp://camera/1" for "rtsp://pilot:secret@camera/1". Every text about a source is so.
std::string redacted(const std::string& source);

// The source with user and password from a file: one line "USER:PASSWORD", mode 0600 or narrower. Throws UsageError for
// a source that is no network address or that has some already, and for a file of another form; Error when it cannot be
// read.
std::string with_credentials(const std::string& source, const std::filesystem::path& file);

// Throws UsageError for an unknown kind of source, Error when the plug-in is missing.
std::unique_ptr<CameraSource> open_camera(const std::string& source, const FlightClock& clock,
                                          const std::vector<std::filesystem::path>& plugins = plugin_folders(),
                                          Backlog backlog = Backlog::skip);

}  // namespace nadir
