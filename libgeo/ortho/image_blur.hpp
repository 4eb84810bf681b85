// Blur of an aerial image, measured at its edges alone, so that fields and snow, which have few and weak ones, are not
// taken for blur. A step edge of contrast c, blurred with sigma s and then by us with sigma b, has the gradient
//
//   g(b) = c / sqrt(2 pi (s² + b²)),   so   (g(b1) / g(b2))² = (s² + b2²) / (s² + b1²)
//
// whatever its contrast. Source: Zhuo and Sim, "Defocus map estimation from a single image", Pattern Recognition 44
// (2011), with two blurs (b1 = 1, b2 = 2 pixels) instead of one, so that noise does not count as detail.
//
// Each direction is measured separately: motion blur leaves the edges along the motion sharp.
#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>

namespace nadir {

// Standard deviation of the blur in pixels, in the worst direction: the median of its edges, since the sharpest are
// noise and the softest shadows. Texture on both sides of an edge reduces it a little. Motion blur of L pixels counts
// as about L / sqrt(12) and more. Nothing when there are too few edges. grey: CV_8UC1.
std::optional<double> blur_of(const cv::Mat& grey);

}  // namespace nadir
