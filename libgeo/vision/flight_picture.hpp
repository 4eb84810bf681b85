// Pictures of a camera as the localizer wants them: grey, and no larger than it looks at.
#pragma once

#include <opencv2/core/mat.hpp>

#include "base/bytes.hpp"
#include "vision/camera_model.hpp"

namespace nadir {

// How much smaller pictures of this camera may be decoded without loss for the localizer, which looks at some 500
// pixels across: a large JPEG costs a fraction then. 1, 2, 4 or 8; 1 where halves would not be whole.
int harmless_shrink(int width, int height);

// CV_8UC1 of the picture's size divided by `shrink`; empty when it is damaged or not of the size that the camera makes:
// the localizer then calls the frame unfit.
cv::Mat decode_flight_picture(ByteView encoded, const CameraModel& camera, int shrink);

}  // namespace nadir
