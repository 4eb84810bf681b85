// Whether two images of one tile show the same ground, and how far they are shifted.
//
// Their local means over 25 pixels are subtracted: light and season change those more than the fine structure. The
// shift is the peak of the phase correlation, to a fraction of a pixel: the centroid of its 5 × 5 neighbourhood
// (Foroosh et al. 2002). Agreement there is Pearson's correlation coefficient of the overlap (-1 to 1).
//
// What depends on one image alone is computed once, however many others it is compared with: twelve flights over one
// address are 66 pairs. That is why cv::phaseCorrelate is not called, which transforms both images for each pair.
#pragma once

#include <opencv2/core/mat.hpp>

#include "imagery/fourier.hpp"

namespace nadir {

// What a comparison needs of an image. 780 KB for a tile.
struct FineStructure {
  explicit FineStructure(const cv::Mat& grey);  // CV_8UC1

  cv::Mat values;     // CV_32FC1: grey levels less their local means
  Spectrum spectrum;  // of the values under a Hann window
};

struct Agreement {
  double shift_px = 0;  // length
  double correlation = 0;
};

// Of images of the same size. Symmetric except for rounding.
Agreement compare_images(const FineStructure& one, const FineStructure& other);

}  // namespace nadir
