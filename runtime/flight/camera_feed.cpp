#include "flight/camera_feed.hpp"

#include <algorithm>
#include <utility>

#include "base/platform.hpp"
#include "imagery/codecs.hpp"

namespace nadir {
namespace {

constexpr std::chrono::milliseconds kLongestWait{200};
constexpr double kAfterTrouble_s = 0.2, kThreadLimit_s = 5;

// The recorder and the localizer know encoded pictures. Lossless, because the recording must give the same bits again.
Bytes encoded(CameraFrame& frame) {
  if (!frame.raw) return std::move(frame.bytes);
  const cv::Mat pixels(frame.raw->height, frame.raw->width, frame.raw->channels == 1 ? CV_8UC1 : CV_8UC3,
                       frame.bytes.data());
  return encode_image(pixels, ImageFormat::png);
}

}  // namespace

CameraFeed::CameraFeed(std::unique_ptr<CameraSource> source, double capture_delay_s, const FlightClock& clock,
                       LatestMailbox<FlightPicture>& pictures, ThreadWatch& watch,
                       std::function<void(const std::string&)> told)
    : source_(std::move(source)),
      capture_delay_s_(capture_delay_s),
      clock_(clock),
      pictures_(pictures),
      told_(std::move(told)),
      beat_(watch.watch("camera", kThreadLimit_s)),
      thread_([this](const std::stop_token& stop) { run(stop); }) {}

void CameraFeed::run(const std::stop_token& stop) {
  begin_thread("camera", ThreadPriority::normal);
  while (!stop.stop_requested()) {
    beat_();
    CameraReading reading = source_->next(patience(), stop);
    const bool frame = reading.news == CameraNews::frame;
    hand_on_settled(frame ? reading.frame.time_s : clock_.monotonic_s());
    if (reading.news == CameraNews::nothing) continue;
    if (frame) {
      take(std::move(reading.frame));
      continue;
    }
    tell(reading.detail);
    clock_.wait_until(clock_.monotonic_s() + kAfterTrouble_s, stop);
  }
}

// Until the held picture may be handed on.
std::chrono::milliseconds CameraFeed::patience() const {
  const auto settled_s = guard_.settled_s();
  if (!held_ || !settled_s) return kLongestWait;
  const std::chrono::duration<double> left(std::clamp(*settled_s - clock_.monotonic_s(), 0.0, 1.0));
  return std::min(kLongestWait, std::chrono::ceil<std::chrono::milliseconds>(left));
}

void CameraFeed::take(CameraFrame frame) {
  switch (guard_.judge(frame.time_s)) {
    case BacklogGuard::Verdict::fresh: hand_on(frame); break;
    case BacklogGuard::Verdict::wait: held_ = std::move(frame); break;
    case BacklogGuard::Verdict::stale: leave_out_with_held(); break;
  }
}

void CameraFeed::hand_on(CameraFrame& frame) {
  held_.reset();
  last_trouble_.clear();
  told_({});
  const double taken_s = frame.time_s - capture_delay_s_;
  pictures_.put({frame.name, encoded(frame), taken_s});
}

void CameraFeed::hand_on_settled(double now_s) {
  const auto settled_s = guard_.settled_s();
  if (!held_ || !settled_s || now_s < *settled_s) return;
  CameraFrame frame = std::move(*held_);
  hand_on(frame);
}

void CameraFeed::leave_out_with_held() {
  left_out_ += held_ ? 2 : 1;
  held_.reset();
  tell("the camera hands out pictures that it had held back; they are left out");
}

void CameraFeed::tell(const std::string& trouble) {
  if (trouble != last_trouble_) told_(trouble);
  last_trouble_ = trouble;
}

}  // namespace nadir
