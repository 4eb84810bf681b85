#include "flight/camera_feed.hpp"

#include <algorithm>
#include <utility>

#include "base/platform.hpp"
#include "imagery/codecs.hpp"

namespace nadir {
namespace {

constexpr std::chrono::milliseconds kMaxWait{200};
constexpr double kOldestFrame_s = 2;  // of one that says when it was exposed: the camera has buffered it
constexpr double kRetry_s = 0.2, kBadFramePeriod_s = 1, kCameraThreadLimit_s = 5;

// Recorder and localizer take encoded images. Lossless, because a replay must have the same pixels.
Bytes encoded(CameraFrame& frame) {
  if (!frame.raw) return std::move(frame.bytes);
  const cv::Mat pixels(frame.raw->height, frame.raw->width, frame.raw->channels == 1 ? CV_8UC1 : CV_8UC3,
                       frame.bytes.data());
  return encode_image(pixels, ImageFormat::png);
}

}  // namespace

CameraFeed::CameraFeed(std::unique_ptr<CameraSource> source, double capture_delay_s, const FlightClock& clock,
                       LatestMailbox<CapturedFrame>& frames, ThreadWatch& watch,
                       std::function<void(OnboardEvent)> on_event)
    : source_(std::move(source)),
      capture_delay_s_(capture_delay_s),
      clock_(clock),
      frames_(frames),
      on_event_(std::move(on_event)),
      beat_(watch.watch("camera", kCameraThreadLimit_s)),
      thread_([this](const std::stop_token& stop) { run(stop); }) {}

void CameraFeed::run(const std::stop_token& stop) {
  begin_thread("camera", ThreadPriority::normal);
  while (!stop.stop_requested()) {
    beat_();
    CameraReading reading = source_->next(kMaxWait, stop);
    if (reading.status == CameraStatus::timeout) continue;
    if (reading.status == CameraStatus::frame) {
      on_frame(std::move(reading.frame));
      continue;
    }
    if (reading.status == CameraStatus::bad_frame) {
      on_bad_frame(reading.detail);
      continue;
    }
    on_failure(reading.detail);
    clock_.wait_until(clock_.monotonic_s() + kRetry_s, stop);
  }
}

void CameraFeed::on_frame(CameraFrame frame) {
  if (frame.age_s) {
    *frame.age_s > kOldestFrame_s ? drop_stale() : deliver(frame);
    return;
  }
  switch (guard_.classify(frame.time_s)) {
    case BacklogGuard::Verdict::fresh: deliver(frame); break;
    case BacklogGuard::Verdict::unproven: ++stale_; break;
    case BacklogGuard::Verdict::stale: drop_stale(); break;
  }
}

void CameraFeed::deliver(CameraFrame& frame) {
  last_failure_.clear();
  on_event_(FrameReceived{});
  const double captured_s = frame.time_s - frame.age_s.value_or(0) - capture_delay_s_;
  frames_.put({frame.name, encoded(frame), captured_s});
}

void CameraFeed::drop_stale() {
  ++stale_;
  on_failure("the camera delivers stale frames from its buffer; they are dropped");
}

// Anybody who can write to the camera's folder can fill it with broken files: they cost neither time nor events.
void CameraFeed::on_bad_frame(const std::string& reason) {
  const double now_s = clock_.monotonic_s();
  if (bad_frame_s_ && now_s - *bad_frame_s_ < kBadFramePeriod_s) return;
  bad_frame_s_ = now_s;
  on_failure(reason);
}

void CameraFeed::on_failure(const std::string& reason) {
  if (reason != last_failure_) on_event_(CameraFailed{reason});
  last_failure_ = reason;
}

}  // namespace nadir
