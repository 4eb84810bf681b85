#include "replay/recorded_walk.hpp"

#include <utility>

namespace nadir {
namespace {

std::uint64_t frame_after(const BetweenFrames& told) {
  if (const auto* anchor = std::get_if<LateAnchor>(&told)) return anchor->taken_after + 1;
  return std::get<HintRecord>(told).before;
}

}  // namespace

FrameReport RecordedWalk::frame(const cv::Mat& picture, const Telemetry& told, std::vector<EstimateRecord>& estimates) {
  FrameReport report;
  if (index_ == 0) tell_until(0, report, estimates);
  if (recorded_ == nullptr || !recorded_->session.looked_up_later) {
    report = localizer_.process(picture, told);
    add(report, estimates);
  } else {
    Localizer::TrackedFrame followed = localizer_.track(picture, told);
    report = std::move(followed.report);
    add(report, estimates);
    if (followed.job) {
      job_ = std::move(followed.job);
      job_index_ = index_;
    }
  }
  tell_until(index_ + 1, report, estimates);
  ++index_;
  return report;
}

void RecordedWalk::add(const FrameReport& report, std::vector<EstimateRecord>& estimates) const {
  estimates.push_back({index_, report.estimate, report.odometry, report.state});
}

void RecordedWalk::tell_until(std::uint64_t before, FrameReport& report, std::vector<EstimateRecord>& estimates) {
  if (recorded_ == nullptr) return;
  const auto& between = recorded_->between;
  for (; next_ < between.size() && frame_after(between[next_]) <= before; ++next_) {
    if (const auto* hint = std::get_if<HintRecord>(&between[next_])) {
      localizer_.hint(hint->place, hint->radius_m);
    } else {
      finish(std::get<LateAnchor>(between[next_]), report, estimates);
    }
  }
}

// Looked up when it was taken in: by then as much had been followed. A frame that was unfit for a look has an anchor
// record too, but no job.
void RecordedWalk::finish(const LateAnchor& anchor, FrameReport& report, std::vector<EstimateRecord>& estimates) {
  if (!job_ || anchor.index != job_index_) return;
  if (anchor.looked) job_->run();
  const OdometryReport odometry = report.odometry;
  report = localizer_.finish(std::exchange(job_, nullptr));
  report.odometry = odometry;
  add(report, estimates);
}

}  // namespace nadir
