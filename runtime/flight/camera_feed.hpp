// The camera's thread: pictures go into the localizer's mailbox, where the latest wins; what happens to the camera is
// told. Pictures that the camera had held back in a pause are left out (backlog_guard.hpp).
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <thread>

#include "camera/backlog_guard.hpp"
#include "camera/camera_source.hpp"
#include "flight/localizing.hpp"

namespace nadir {

class CameraFeed {
 public:
  // told: on the feed's thread; empty text: a picture came.
  CameraFeed(std::unique_ptr<CameraSource> source, double capture_delay_s, const FlightClock& clock,
             LatestMailbox<FlightPicture>& pictures, ThreadWatch& watch,
             std::function<void(const std::string& trouble)> told);

  std::string describe() const { return source_->describe(); }

  // Pictures that came, but were held back before: nobody else counts them. From any thread.
  std::uint64_t left_out() const { return left_out_; }

 private:
  void run(const std::stop_token& stop);
  std::chrono::milliseconds patience() const;
  void take(CameraFrame frame);
  void hand_on(CameraFrame& frame);
  void hand_on_settled(double now_s);
  void leave_out_with_held();
  void tell(const std::string& trouble);

  std::unique_ptr<CameraSource> source_;
  double capture_delay_s_;
  const FlightClock& clock_;
  LatestMailbox<FlightPicture>& pictures_;
  std::function<void(const std::string&)> told_;
  BacklogGuard guard_;
  std::optional<CameraFrame> held_;  // until it is known whether it is of now
  std::atomic<std::uint64_t> left_out_{0};
  std::string last_trouble_;
  ThreadWatch::Beat beat_;
  std::jthread thread_;  // last: it uses everything above
};

}  // namespace nadir
