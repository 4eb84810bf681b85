// One tile mosaicked from what several frames show of it.
//
// Every frame that takes part may make tiles by itself (ortho/eligibility.hpp) and must agree with the others: before a
// partial tile is merged, its overlap with those that are there is registered (measure_seam()). A partial tile that is
// misaligned, or whose overlap cannot be compared, stays out. Where several frames show a pixel, the one with the lowest
// cost_mm() for that pixel wins: better known position, smaller view angle, sharper.
//
// A mosaic takes half a megabyte, however many frames come. The same frames in the same order give the same pixels.
#pragma once

#include <array>
#include <cstdint>
#include <list>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "ortho/candidate_sidecar.hpp"
#include "ortho/orthorectifier.hpp"

namespace nadir {

struct Seam {
  double shift_px = 0;     // of the other picture against the one
  double correlation = 0;  // there, Pearson's
};

// one, other: CV_8UC3 of one size; common: CV_8UC1, 255 where both show the ground. Shifts of up to reach_px a side are
// looked for. Nothing when too little is common to both.
std::optional<Seam> measure_seam(const cv::Mat& one, const cv::Mat& other, const cv::Mat& common, int reach_px);

struct MosaicLimits {
  double max_seam_m = 2;         // that two pieces may lie apart
  double min_correlation = 0.5;  // of what two pieces have in common; below it nothing is proven
  double max_span_s = 900;       // between the oldest piece and the newest: one pass, one light
  double candidate_sigma_m = 3;  // of the whole, what the pieces disagree by included
  double soft_sigma_m = 5;
  std::size_t most_open = 48;  // tiles that wait for their missing parts
};

// What became of a piece.
enum class PartialTileOutcome {
  joined,
  hidden,    // it shows nothing better than what is there
  unproven,  // too little is common, or it looks too different
  apart,     // it shows the ground elsewhere than what is there
  full,      // kMaxCandidateParts frames show it already
};
inline constexpr int kPartialTileOutcomes = 5;
std::string_view name_of(PartialTileOutcome fate);

class TileMosaic {
 public:
  // pixel_m: of the tile on the ground.
  TileMosaic(const TileKey& key, double pixel_m, const MosaicLimits& limits);

  // frame: what would be written of the frame's own tile; its key, quality but for sharpness, digest and size do not
  // count.
  PartialTileOutcome add(const PartialTile& patch, const CandidateSidecar& frame);

  bool whole() const { return missing_px_ == 0; }
  int shown_px() const { return kTileSize * kTileSize - missing_px_; }
  bool spans(UtcMillis time) const;  // would a frame of then still be of the same pass?
  const TileKey& key() const { return key_; }
  const cv::Mat& image() const { return image_; }

  // Of the whole tile as it is now, without what its pixels say (contrast, clipped), its digest and size. Nothing when
  // the parts' places are too unsure together.
  std::optional<CandidateSidecar> sidecar() const;

 private:
  struct Piece {
    CandidateSidecar frame;
    std::int64_t seam_mm = 0;
    int pixels = 0;  // of the tile that show it
  };
  std::size_t free_piece() const;

  TileKey key_;
  double pixel_m_;
  MosaicLimits limits_;
  // CV_8UC3; CV_32FC1, tangents; CV_32FC1, squared cost_mm(); CV_8UC1, kNobody or an index
  cv::Mat image_, slants_, cost_mm2_, owner_;
  std::array<Piece, kMaxCandidateParts> pieces_;
  int missing_px_ = kTileSize * kTileSize;
};

class TileMosaics {
 public:
  explicit TileMosaics(const MosaicLimits& limits) : limits_(limits) {}

  // A piece that stays out but shows more than all that are there takes their place.
  PartialTileOutcome add(const PartialTile& patch, const CandidateSidecar& frame, double pixel_m);

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

  MosaicLimits limits_;
  std::list<Waiting> waiting_;  // what was added to last comes last
  std::vector<TileMosaic> finished_;
  std::uint64_t dropped_ = 0;
};

}  // namespace nadir
