// The camera's thread: pictures go into the localizer's mailbox, where the latest wins; what happens to the camera is
// told.
#pragma once

#include <functional>
#include <memory>
#include <thread>

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

 private:
  void run(const std::stop_token& stop);

  std::unique_ptr<CameraSource> source_;
  double capture_delay_s_;
  const FlightClock& clock_;
  LatestMailbox<FlightPicture>& pictures_;
  std::function<void(const std::string&)> told_;
  ThreadWatch::Beat beat_;
  std::jthread thread_;  // last: it uses everything above
};

}  // namespace nadir
