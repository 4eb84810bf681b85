// How blurred is a picture of the ground? Judged by its edges alone, so that fields and snow, which have few and weak
// ones, are not taken for blurred pictures: an edge that a blur of sigma s has drawn out gets flatter by a known factor
// when it is blurred once more by a known amount, whatever its contrast. Source: Zhuo and Sim, "Defocus map estimation
// from a single image", Pattern Recognition 44 (2011), with two blurs of our own, so that noise does not count as
// detail.
//
// Each direction by itself: a streak of motion leaves the edges along it sharp.
#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>

namespace nadir {

// Standard deviation of the blur in pixels, in the direction in which it is worst, by the middle one of the edges
// there: the sharpest are noise, the softest shadows. Texture on both sides of an edge makes it a little less. A streak
// of L pixels counts about L / sqrt(12) and more. Nothing when there are not enough edges to tell. grey: CV_8UC1.
std::optional<double> blur_of(const cv::Mat& grey);

}  // namespace nadir
