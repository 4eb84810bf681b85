#include "ortho/tile_quilts.hpp"

#include <algorithm>
#include <utility>

namespace nadir {

void TileMosaics::give_up(std::list<Waiting>::iterator waiting) {
  if (waiting->quilt.whole()) {
    finished_.push_back(std::move(waiting->quilt));
  } else {
    ++dropped_;
  }
  waiting_.erase(waiting);
}

PieceOutcome TileMosaics::add(const PartialTile& patch, const CandidateSidecar& frame, double pixel_m) {
  auto found = std::find_if(waiting_.begin(), waiting_.end(),
                            [&](const Waiting& waiting) { return waiting.quilt.key() == patch.key; });
  if (found != waiting_.end() && !found->quilt.spans(frame.captured_at)) {
    give_up(found);
    found = waiting_.end();
  }
  if (found == waiting_.end()) {
    if (waiting_.size() >= limits_.most_open) give_up(waiting_.begin());
    found = waiting_.insert(waiting_.end(), {TileMosaic(patch.key, pixel_m, limits_)});
  }
  PieceOutcome fate = found->quilt.add(patch, frame);
  const bool stays_out = fate != PieceOutcome::joined && fate != PieceOutcome::hidden;
  if (stays_out && patch.seen_px > found->quilt.shown_px()) {
    // What came first must not keep out what shows more: nobody can tell which of the two is right.
    found->quilt = TileMosaic(patch.key, pixel_m, limits_);
    found->quilt.add(patch, frame);
    found->touched = true;
  }
  if (fate == PieceOutcome::joined) {
    found->touched = true;
    waiting_.splice(waiting_.end(), waiting_, found);
  }
  return fate;
}

std::vector<TileMosaic> TileMosaics::take_finished() {
  for (auto waiting = waiting_.begin(); waiting != waiting_.end();) {
    const auto here = waiting++;
    if (here->quilt.whole() && !here->touched) {
      give_up(here);
    } else {
      here->touched = false;
    }
  }
  std::sort(finished_.begin(), finished_.end(),
            [](const TileMosaic& a, const TileMosaic& b) { return a.key() < b.key(); });
  return std::exchange(finished_, {});
}

std::vector<TileMosaic> TileMosaics::take_all_whole() {
  while (!waiting_.empty()) give_up(waiting_.begin());
  return take_finished();
}

}  // namespace nadir
