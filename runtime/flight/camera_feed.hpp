// The camera's thread: frames go into the localizer's mailbox, where the latest wins; failures are reported. Frames
// that the camera may have buffered during a pause are dropped: by the age that they state, else by backlog_guard.hpp.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <thread>

#include "camera/backlog_guard.hpp"
#include "camera/camera_source.hpp"
#include "flight/localization_thread.hpp"

namespace nadir {

class CameraFeed {
 public:
  // on_event gets FrameReceived and CameraFailed, on the camera's thread.
  CameraFeed(std::unique_ptr<CameraSource> source, double capture_delay_s, const FlightClock& clock,
             LatestMailbox<CapturedFrame>& frames, ThreadWatch& watch, std::function<void(OnboardEvent)> on_event);

  std::string describe() const { return source_->describe(); }

  // Stale and unproven frames, which were dropped: no mailbox counts them. From any thread.
  std::uint64_t stale() const { return stale_; }

 private:
  void run(const std::stop_token& stop);
  void on_frame(CameraFrame frame);
  void deliver(CameraFrame& frame);
  void drop_stale();
  void on_bad_frame(const std::string& reason);
  void on_failure(const std::string& reason);

  std::unique_ptr<CameraSource> source_;
  double capture_delay_s_;
  const FlightClock& clock_;
  LatestMailbox<CapturedFrame>& frames_;
  std::function<void(OnboardEvent)> on_event_;
  BacklogGuard guard_;
  std::atomic<std::uint64_t> stale_{0};
  std::string last_failure_;
  std::optional<double> bad_frame_s_;  // when one was reported
  ThreadWatch::Beat beat_;
  std::jthread thread_;  // last: it uses everything above
};

}  // namespace nadir
