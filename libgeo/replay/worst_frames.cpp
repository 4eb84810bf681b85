#include "replay/worst_frames.hpp"

#include <algorithm>

#include "replay/pictures.hpp"

namespace nadir {
namespace {

constexpr int kPictureSide = 360;  // pixels
constexpr int kQuality = 78;

}  // namespace

void WorstFrames::offer(std::size_t index, double badness, const AnchorReport& anchor) {
  if (anchor.rectified.empty() || anchor.matched_map.empty()) return;
  if (kept_.size() == capacity_ && badness <= kept_.back().badness) return;
  const auto place = std::find_if(kept_.begin(), kept_.end(),
                                  [badness](const FramePictures& other) { return badness > other.badness; });
  kept_.insert(place, {index, badness, jpeg_data_uri(anchor.rectified, kPictureSide, kQuality),
                       jpeg_data_uri(anchor.matched_map, kPictureSide, kQuality)});
  if (kept_.size() > capacity_) kept_.pop_back();
}

double badness_of(const FrameReport& report, std::optional<double> error_m) {
  if (error_m) return *error_m;
  const bool refused = report.anchor.verdict != AnchorVerdict::accepted;
  return (refused ? 10 : 0) + report.anchor.ratio;
}

}  // namespace nadir
