// An image with a validity mask: the form in which imagery passes through a build.
#pragma once

#include <opencv2/core/mat.hpp>

namespace nadir {

struct MaskedImage {
  cv::Mat bgr;   // CV_8UC3
  cv::Mat mask;  // CV_8UC1, 255 = shows ground, 0 = does not
};

// Half the size (sides must be even): averages of the valid pixels. A pixel is valid when at least two of its four are.
MaskedImage halved(const MaskedImage& image);

// Gives invalid pixels colours that continue the valid ones without an edge: averages over ever larger neighbourhoods
// (the pull-push pyramids of Gortler et al., "The Lumigraph", 1996). JPEG then has no black to smear into the map.
void fill_invalid(MaskedImage& image);

}  // namespace nadir
