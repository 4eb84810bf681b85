#include "recorder/recorder.hpp"

namespace nadir {
namespace {

bool failed(AnchorVerdict verdict) {
  return verdict != AnchorVerdict::not_tried && verdict != AnchorVerdict::accepted &&
         verdict != AnchorVerdict::awaiting_votes;
}

void record_attempt(Recorder& recorder, std::uint64_t index, std::uint64_t taken_after, const FrameReport& report) {
  AnchorRecord anchor{index, report.estimate.frame, report.estimate.time_s, report.anchor, taken_after};
  anchor.anchor.rectified.release();
  anchor.anchor.matched_map.release();
  recorder.record(std::move(anchor));
  if (!failed(report.anchor.verdict) || report.anchor.rectified.empty()) return;
  recorder.offer_thumbnail(
      {index, report.estimate.frame, report.anchor.verdict, report.anchor.rectified, report.anchor.matched_map});
}

}  // namespace

void record_frame(Recorder& recorder, std::uint64_t index, const FrameReport& report) {
  recorder.record(EstimateRecord{index, report.estimate, report.odometry, report.state});
  if (report.anchor.verdict != AnchorVerdict::not_tried) record_attempt(recorder, index, index, report);
}

void record_anchor(Recorder& recorder, std::uint64_t index, std::uint64_t taken_after, const FrameReport& report) {
  record_attempt(recorder, index, taken_after, report);
  recorder.record(EstimateRecord{taken_after, report.estimate, report.odometry, report.state});
}

void record_input(Recorder& recorder, std::uint64_t index, const Telemetry& told, ByteView encoded) {
  recorder.record(InputRecord{index, told, sha256(encoded), encoded.size()});
  if (!recorder.keeps_pictures()) return;
  recorder.record(PictureRecord{index, told.frame, Bytes(encoded.begin(), encoded.end())});
}

}  // namespace nadir
