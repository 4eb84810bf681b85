// What a piece of ground looks like, as 384 numbers: the six oriented-gradient channels (oriented_channels.hpp) of a
// square patch, pooled softly into 8 x 8 cells.
//
// Made to survive another season and sensor: the channels do not know bright-to-dark from dark-to-bright and are
// levelled; each channel's mean over the seen cells is removed (without that the density of edges decides, and half of
// the right places are lost); the root of each value keeps one bright roof from outvoting a hundred hedges. Cells that
// the patch does not show are 0, which after the removal of the mean says nothing.
#pragma once

#include <array>
#include <cstddef>
#include <opencv2/core/mat.hpp>
#include <optional>

namespace nadir {

inline constexpr int kPlaceCells = 8;  // a side
inline constexpr int kPlaceOrientations = 6;
inline constexpr std::size_t kRawPlaceSize = std::size_t{kPlaceCells} * kPlaceCells * kPlaceOrientations;

using RawPlaceDescriptor = std::array<float, kRawPlaceSize>;  // by orientation, then rows of cells; of length 1

struct PlacePatch {
  cv::Mat grey;  // CV_8UC1, square
  cv::Mat mask;  // CV_8UC1, 255 where it shows ground
};

// Nothing when fewer than a quarter of the cells show ground, or when there is no structure at all.
std::optional<RawPlaceDescriptor> describe_place(const PlacePatch& patch);

// Root mean square gradient under the mask, grey levels per pixel: water and snow have next to none.
double texture_of(const PlacePatch& patch);
inline constexpr double kMinPlaceTexture = 0.8;

// How a patch lies in a north-up picture.
struct PatchPlacement {
  cv::Point2d centre;        // in the picture's pixels, the top-left pixel's centre at (0.5, 0.5)
  double turn_rad = 0;       // the patch's rows run clockwise of the picture's rows by this
  double pixels_per_px = 1;  // picture pixels per pixel of the patch
  cv::Point2d shift_px;      // the patch's middle from `centre`, along the patch's own rows and columns
  int side_px = 96;
};

// Shrinks smoothly where the picture is finer than the patch.
class PatchCutter {
 public:
  // pixels_per_px: of the patches that will be cut.
  PatchCutter(const cv::Mat& grey, const cv::Mat& mask, double pixels_per_px);

  PlacePatch cut(const PatchPlacement& placement) const;

 private:
  cv::Mat grey_;
  cv::Mat mask_;
};

}  // namespace nadir
