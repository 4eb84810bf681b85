// A camera that says by MAVLink where its video stream is (MAVLink Camera Protocol v2).
//
//   --camera mavlink:COMPONENT[:STREAM]
//
// The camera is asked for CAMERA_INFORMATION and VIDEO_STREAM_INFORMATION, once a second until it has named a stream
// that can be used: RTSP, with pictures of the size that the airframe file has calibrated, and that number if one was
// given. Of several the one that runs counts, then the first. It is asked again now and then, because a camera that was
// restarted may have moved. What it says is trusted as far as the link is: a signed link passes on signed messages
// alone.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "camera/camera_source.hpp"
#include "mavlink/messages.hpp"

namespace nadir {

struct MavlinkCamera {
  std::uint8_t component = 0;
  std::optional<int> stream{};
};

// Nothing for a source of another kind. Throws UsageError.
std::optional<MavlinkCamera> mavlink_camera(const std::string& source);

class VideoStreamFinder {
 public:
  // width, height: of the calibrated camera. 0: any.
  VideoStreamFinder(std::uint8_t system, MavlinkCamera wanted, int width, int height)
      : camera_{system, wanted.component}, wanted_(wanted), width_(width), height_(height) {}

  // From any thread each.
  std::vector<CommandLong> requests(double now_s);  // that are due
  void on_message(MavlinkAddress source, const IncomingMessage& message);
  std::optional<std::string> found() const;
  std::string uri() const;      // the same; throws Error: none is known, and why
  std::string offered() const;  // what the camera has said, for people

 private:
  std::optional<VideoStream> chosen() const;
  bool fits(const VideoStream& stream) const;
  std::string what_it_said() const;

  const MavlinkAddress camera_;
  const MavlinkCamera wanted_;
  const int width_, height_;

  mutable std::mutex mutex_;
  std::optional<double> asked_s_;
  std::optional<CameraInformation> information_;
  std::map<int, VideoStream> streams_;  // by number
};

// The stream as a source of frames: opened when its address is known, and again when that changes.
class StreamCamera final : public CameraSource {
 public:
  using Open = std::function<std::unique_ptr<CameraSource>(const std::string& uri)>;

  // finder: must outlive this.
  StreamCamera(const VideoStreamFinder& finder, Open open) : finder_(finder), open_(std::move(open)) {}

  CameraReading next(std::chrono::milliseconds at_most, std::stop_token stop) override;
  std::string describe() const override;

 private:
  const VideoStreamFinder& finder_;
  Open open_;
  std::string uri_;
  std::unique_ptr<CameraSource> camera_;
};

}  // namespace nadir
