// Do two pictures of one tile show the same ground, and how far do they lie apart?
//
// The means of both over 25 pixels are taken away: light and season change those more than what is finer. Where the
// phases of the two correlate best is the shift (cv::phaseCorrelate, Foroosh et al. 2002, to a fraction of a pixel);
// whether they agree there says the correlation coefficient of what lies upon each other (-1 to 1).
#pragma once

#include <opencv2/core/mat.hpp>

namespace nadir {

struct Agreement {
  double shift_px = 0;  // length
  double correlation = 0;
};

// Both CV_8UC1 and of one size. Symmetric but for rounding.
Agreement compare_pictures(const cv::Mat& one, const cv::Mat& other);

}  // namespace nadir
