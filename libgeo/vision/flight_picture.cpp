#include "vision/flight_picture.hpp"

#include <algorithm>

#include "base/error.hpp"
#include "imagery/codecs.hpp"

namespace nadir {

int harmless_shrink(int width, int height) {
  constexpr int kLeastSide = 1280, kLargest = 8;
  int shrink = 1;
  while (shrink < kLargest && std::max(width, height) / (2 * shrink) >= kLeastSide && width % (2 * shrink) == 0 &&
         height % (2 * shrink) == 0) {
    shrink *= 2;
  }
  return shrink;
}

cv::Mat decode_flight_picture(ByteView encoded, const CameraModel& camera, int shrink) {
  try {
    cv::Mat picture = decode_image(encoded, Colour::grey, "picture", shrink).image;
    if (picture.cols != camera.width || picture.rows != camera.height) return {};
    return picture;
  } catch (const Error&) {
    return {};
  }
}

}  // namespace nadir
