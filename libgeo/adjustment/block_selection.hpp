// Which measurements of a block take part in its adjustment, and which frames they connect.
//
// A tie point takes part with two rays or more (kMinRays), a control point with one. Frames that see a point together
// are connected, and so are frames that follow each other where too few points tie either. A connected part is anchored
// to the map where an anchor, a control point or a held frame that is anchored belongs to it. Between two solutions
// decide() switches off what contradicts the present one, and on again what does not any more.
#pragma once

#include <cstddef>
#include <vector>

#include "adjustment/adjustment_run.hpp"

namespace nadir {

class BlockSelection {
 public:
  // Frames of the window are free, all others held.
  BlockSelection(const BlockData& data, BlockState& state, FrameWindow window);

  void place_points();
  bool decide();   // whether anything changed
  void connect();  // of what takes part now

  bool any_free() const;
  bool free(std::size_t frame) const { return free_[frame]; }
  bool adjusted(std::size_t anchor) const { return free_[data_.anchors[anchor].frame]; }
  bool kept(std::size_t anchor) const { return kept_[anchor]; }
  bool used(std::size_t point) const { return used_[point]; }
  ObservationUse use(std::size_t point, std::size_t observation) const { return uses_[point][observation]; }
  std::size_t observations(std::size_t frame) const { return counts_[frame]; }  // that are used
  // The first frame that this one is connected with, directly or through others.
  std::size_t part(std::size_t frame) const { return part_[frame]; }
  bool anchored(std::size_t part) const { return anchored_[part]; }
  const std::vector<bool>& parts_with_held_frames() const { return held_; }
  // Frames that follow each other and that too few points tie.
  bool motion_between(std::size_t i) const;             // i - 1 and i
  double anchor_chi2(const BlockAnchor& anchor) const;  // by the present state

 private:
  const BlockData& data_;
  BlockState& state_;
  std::vector<bool> free_;
  std::vector<bool> kept_;                         // per anchor
  std::vector<std::vector<ObservationUse>> uses_;  // per point and observation
  std::vector<bool> used_;                         // per point
  std::vector<std::size_t> counts_;                // per frame
  std::vector<std::size_t> part_;                  // likewise
  std::vector<bool> anchored_, held_;              // per part
};

}  // namespace nadir
