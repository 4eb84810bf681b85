// The localizer walked through a flight in the order in which things happened to it in the air: hints and anchors that
// came between two frames come between them again.
#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "estimation/localizer.hpp"
#include "replay/flight_recording.hpp"

namespace nadir {

class RecordedWalk {
 public:
  // recorded: null for a flight that nobody recorded: each frame is then localized before the next. Both must outlive
  // this.
  RecordedWalk(Localizer& localizer, const RecordedFlight* recorded) : localizer_(localizer), recorded_(recorded) {}

  // The next frame, and all that came before the one after it. Every estimate is added to `estimates`; the report has
  // the last. Throws UsageError for a recorded hint that is no place.
  FrameReport frame(const cv::Mat& picture, const Telemetry& told, std::vector<EstimateRecord>& estimates);

 private:
  void add(const FrameReport& report, std::vector<EstimateRecord>& estimates) const;
  void tell_until(std::uint64_t before, FrameReport& report, std::vector<EstimateRecord>& estimates);
  void finish(const LateAnchor& anchor, FrameReport& report, std::vector<EstimateRecord>& estimates);

  Localizer& localizer_;
  const RecordedFlight* recorded_;
  std::uint64_t index_ = 0;  // of the frame at hand
  std::size_t next_ = 0;     // of recorded_->between
  std::unique_ptr<AnchorJob> job_;
  std::uint64_t job_index_ = 0;
};

}  // namespace nadir
