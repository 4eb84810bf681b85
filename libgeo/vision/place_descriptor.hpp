// Descriptor of a piece of ground, 384 numbers: the six oriented-gradient channels (oriented_channels.hpp) of a
// square patch, pooled with Gaussian weights into 8 x 8 cells; and as 128 numbers, by principal components.
//
// Robust to season and sensor: the channels do not distinguish bright-to-dark from dark-to-bright and are
// normalised; each channel's mean over the cells with ground is removed (without that the density of edges decides, and
// half of the right places are lost); the signed root of each value keeps one bright roof from outweighing a hundred
// hedges. Cells that the patch does not show are 0, which is the mean after its removal.
#pragma once

#include <array>
#include <cstddef>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <span>
#include <vector>

#include "vision/localizer_parameters.hpp"

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

// How a patch lies in a north-up image.
struct PatchPlacement {
  cv::Point2d centre;        // in the image's pixels, the top-left pixel's centre at (0.5, 0.5)
  double turn_rad = 0;       // the patch's rows run clockwise of the image's rows by this
  double pixels_per_px = 1;  // image pixels per pixel of the patch
  cv::Point2d shift_px;      // the patch's middle from `centre`, along the patch's own rows and columns
  int side_px = kPlacePatch_px;
};

// Cuts patches out of an image, low-pass filtered where the image is finer than the patch.
class PatchCutter {
 public:
  // pixels_per_px: of the patches that will be cut.
  PatchCutter(const cv::Mat& grey, const cv::Mat& mask, double pixels_per_px);

  PlacePatch cut(const PatchPlacement& placement) const;

 private:
  cv::Mat grey_;
  cv::Mat mask_;
};

inline constexpr std::size_t kPlaceSize = 128;

using PlaceVector = std::array<float, kPlaceSize>;  // of length 1: inner products are cosines

// Principal components of place descriptors: nearly all of the variance in a third of the numbers. Trained on the
// ground that is indexed, stored with the index.
struct PlaceProjection {
  std::vector<float> mean;   // kRawPlaceSize
  std::vector<float> basis;  // kPlaceSize rows of kRawPlaceSize, the strongest component first
  double kept = 0;           // share of the variance

  PlaceVector project(const RawPlaceDescriptor& descriptor) const;
};

// The same samples give the same projection: each component's largest coefficient is positive.
PlaceProjection train_projection(std::span<const RawPlaceDescriptor> samples);

}  // namespace nadir
