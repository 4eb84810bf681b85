// One tile pieced together of what several frames show of it.
//
// Every frame that takes part may make tiles by itself (ortho/eligibility.hpp), and lies where the others lie: before a
// piece is added, what it has in common with those that are there is compared (ortho/seam.hpp), and a piece that lies
// elsewhere, or has nothing in common that could be compared, stays out. Of several frames that show a pixel the one is
// taken that is surer, saw it more from above, and is sharper: by cost_mm() for each pixel.
//
// It takes half a megabyte, however many frames come. The same frames in the same order give the same pixels.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "ortho/candidate_sidecar.hpp"
#include "ortho/tile_patch.hpp"

namespace nadir {

struct QuiltLimits {
  double max_seam_m = 2;         // that two pieces may lie apart
  double min_correlation = 0.5;  // of what two pieces have in common; below it nothing is proven
  double max_span_s = 900;       // between the oldest piece and the newest: one pass, one light
  double candidate_sigma_m = 3;  // of the whole, what the pieces disagree by included
  double soft_sigma_m = 5;
  std::size_t most_open = 48;  // tiles that wait for their missing parts
};

// What became of a piece.
enum class PieceOutcome {
  joined,
  hidden,    // it shows nothing better than what is there
  unproven,  // too little is common, or it looks too different
  apart,     // it shows the ground elsewhere than what is there
  full,      // kMaxCandidateParts frames show it already
};
inline constexpr int kPieceFates = 5;
std::string_view name_of(PieceOutcome fate);

class TileMosaic {
 public:
  // pixel_m: of the tile on the ground.
  TileMosaic(const TileKey& key, double pixel_m, const QuiltLimits& limits);

  // frame: what would be written of the frame's own tile; its key, quality but for sharpness, digest and size do not
  // count.
  PieceOutcome add(const PartialTile& patch, const CandidateSidecar& frame);

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
  QuiltLimits limits_;
  // CV_8UC3; CV_32FC1, tangents; CV_32FC1, squared cost_mm(); CV_8UC1, kNobody or an index
  cv::Mat image_, slants_, cost_mm2_, owner_;
  std::array<Piece, kMaxCandidateParts> pieces_;
  int missing_px_ = kTileSize * kTileSize;
};

}  // namespace nadir
