// Do two pictures of a tile show the ground in the same place, as far as both show it? What of them lies upon each
// other is compared in the largest square that both fill.
#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>

namespace nadir {

struct Seam {
  double shift_px = 0;     // of the other picture against the one
  double correlation = 0;  // there, Pearson's
};

// one, other: CV_8UC3 of one size; common: CV_8UC1, 255 where both show the ground. Shifts of up to reach_px a side are
// looked for. Nothing when too little is common to both.
std::optional<Seam> measure_seam(const cv::Mat& one, const cv::Mat& other, const cv::Mat& common, int reach_px);

}  // namespace nadir
