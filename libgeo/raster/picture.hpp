// A piece of the map while it is made: colours, and which of them are real.
#pragma once

#include <opencv2/core/mat.hpp>

namespace nadir {

struct Picture {
  cv::Mat bgr;   // CV_8UC3
  cv::Mat mask;  // CV_8UC1, 255 = shows ground, 0 = does not
};

// Half the size (sides must be even): averages of the pixels that show ground. A pixel shows ground when at least two
// of its four do.
Picture halved(const Picture& picture);

// Gives pixels that show no ground colours that continue those that do, without an edge: averages of ever larger
// surroundings (the pyramids of Gortler et al., "The Lumigraph", 1996). JPEG then has no black to smear into the map.
void fill_unknown(Picture& picture);

}  // namespace nadir
