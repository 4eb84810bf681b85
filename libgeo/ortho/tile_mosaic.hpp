// One tile mosaicked from what several frames show of it.
//
// Every frame that takes part may make tiles by itself (ortho/eligibility.hpp) and must agree with the others: before a
// partial tile is merged, its overlap with those that are there is registered (measure_seam()). A partial tile that is
// misaligned, or whose overlap cannot be compared, stays out. Where several frames show a pixel, the one with the
// lowest cost_mm() for that pixel wins: better known position, smaller view angle, sharper.
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
  double shift_px = 0;     // displacement of the second image against the first
  double correlation = 0;  // Pearson's, at that displacement
};

// Registers two images of a tile in their overlap: within the largest square that both fill, by normalized
// cross-correlation. one, other: CV_8UC3 of the same size; common: CV_8UC1, 255 where both show the ground. Searches
// displacements of up to reach_px in each direction. Nothing when the overlap is too small.
std::optional<Seam> measure_seam(const cv::Mat& one, const cv::Mat& other, const cv::Mat& common, int reach_px);

struct MosaicLimits {
  double max_seam_m = 2;         // displacement between two partial tiles
  double min_correlation = 0.5;  // in the overlap; below it the alignment is unverified
  double max_span_s = 900;       // between the oldest and the newest part: one pass, one light
  double candidate_sigma_m = 3;  // of the mosaic, including the parts' displacement
  double soft_sigma_m = 5;
  std::size_t max_open = 48;  // mosaics with missing pixels
};

enum class PartialTileOutcome {
  merged,
  redundant,   // nothing better than what the mosaic shows
  unverified,  // too little overlap, or it looks too different
  misaligned,  // shows the ground in another place than the mosaic
  full,        // the mosaic has kMaxCandidateParts parts
};
inline constexpr int kPartialTileOutcomes = 5;
std::string_view name_of(PartialTileOutcome outcome);  // as reports spell it: "joined", "hidden" …

class TileMosaic {
 public:
  // pixel_m: of the tile on the ground.
  TileMosaic(const TileKey& key, double pixel_m, const MosaicLimits& limits);

  // frame: the sidecar of a tile made of this frame alone; key, digest, size and quality except sharpness are ignored.
  PartialTileOutcome add(const PartialTile& partial, const CandidateSidecar& frame);

  bool whole() const { return missing_px_ == 0; }
  int shown_px() const { return kTileSize * kTileSize - missing_px_; }
  bool spans(UtcMillis time) const;  // whether a frame of this time belongs to the same pass
  const TileKey& key() const { return key_; }
  const cv::Mat& image() const { return image_; }

  // Of the complete mosaic in its present state, without the measures of its pixels (contrast, clipped), digest and
  // size. Nothing when the parts' positions together are too uncertain.
  std::optional<CandidateSidecar> sidecar() const;

 private:
  struct Part {
    CandidateSidecar frame;
    std::int64_t seam_mm = 0;
    int pixels = 0;  // of the mosaic
  };
  std::size_t free_part() const;

  TileKey key_;
  double pixel_m_;
  MosaicLimits limits_;
  // CV_8UC3; CV_32FC1, tangents; CV_32FC1, squared cost_mm(); CV_8UC1, kNoPart or an index
  cv::Mat image_, slants_, cost_mm2_, owner_;
  std::array<Part, kMaxCandidateParts> parts_;
  int missing_px_ = kTileSize * kTileSize;
};

// The mosaics that wait for other frames to show their missing pixels: bounded, the least recently extended give way
// first.
class TileMosaics {
 public:
  explicit TileMosaics(const MosaicLimits& limits) : limits_(limits) {}

  // A partial tile that is not merged but shows more than the whole mosaic replaces it.
  PartialTileOutcome add(const PartialTile& partial, const CandidateSidecar& frame, double pixel_m);

  // After the partial tiles of a frame: the complete mosaics that it has not extended, so that no better part is
  // expected soon. In the order of TileKey.
  std::vector<TileMosaic> take_finished();
  std::vector<TileMosaic> take_all_complete();  // at the end; the others are dropped

  std::uint64_t dropped() const { return dropped_; }  // mosaics that were never completed
  std::size_t open() const { return waiting_.size(); }

 private:
  struct Waiting {
    TileMosaic mosaic;
    bool extended = true;  // by the current frame
  };
  void close(std::list<Waiting>::iterator waiting);

  MosaicLimits limits_;
  std::list<Waiting> waiting_;  // the most recently extended comes last
  std::vector<TileMosaic> finished_;
  std::uint64_t dropped_ = 0;
};

}  // namespace nadir
