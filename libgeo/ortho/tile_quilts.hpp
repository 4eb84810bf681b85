// The tiles that wait for other frames to show what is missing of them: bounded, those that were added to longest ago
// give way first.
#pragma once

#include <cstdint>
#include <list>
#include <vector>

#include "ortho/tile_quilt.hpp"

namespace nadir {

class TileMosaics {
 public:
  explicit TileMosaics(const QuiltLimits& limits) : limits_(limits) {}

  // A piece that stays out but shows more than all that are there takes their place.
  PieceOutcome add(const PartialTile& patch, const CandidateSidecar& frame, double pixel_m);

  // After the pieces of a frame: the tiles that are whole and that it has not added to, so that no better piece is to
  // be expected soon. In the order of TileKey.
  std::vector<TileMosaic> take_finished();
  std::vector<TileMosaic> take_all_whole();  // at the end; the others are dropped

  std::uint64_t dropped() const { return dropped_; }  // tiles that never became whole
  std::size_t open() const { return waiting_.size(); }

 private:
  struct Waiting {
    TileMosaic quilt;
    bool touched = true;  // by the present frame
  };
  void give_up(std::list<Waiting>::iterator waiting);

  QuiltLimits limits_;
  std::list<Waiting> waiting_;  // what was added to last comes last
  std::vector<TileMosaic> finished_;
  std::uint64_t dropped_ = 0;
};

}  // namespace nadir
