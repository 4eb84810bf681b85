#include "flight/camera_feed.hpp"

#include "base/thread_rank.hpp"
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
  begin_thread("camera", ThreadRank::beside);
  std::string last_trouble;
  while (!stop.stop_requested()) {
    beat_();
    CameraReading reading = source_->next(kLongestWait, stop);
    if (reading.news == CameraNews::nothing) continue;
    if (reading.news == CameraNews::frame) {
      last_trouble.clear();
      told_({});
      const double taken_s = reading.frame.time_s - capture_delay_s_;
      pictures_.put({reading.frame.name, encoded(reading.frame), taken_s});
      continue;
    }
    if (reading.detail != last_trouble) told_(reading.detail);
    last_trouble = reading.detail;
    clock_.wait_until(clock_.monotonic_s() + kAfterTrouble_s, stop);
  }
}

}  // namespace nadir
