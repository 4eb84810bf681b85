#include "imagery/lossless_webp.hpp"

#include <webp/encode.h>

#include "base/error.hpp"

namespace nadir {

Bytes encode_lossless_webp(const cv::Mat& image) {
  if (image.type() != CV_8UC3) throw Error({.what = "only BGR pictures become lossless WebP"});
  std::uint8_t* data = nullptr;
  const std::size_t size =
      WebPEncodeLosslessBGR(image.data, image.cols, image.rows, static_cast<int>(image.step), &data);
  if (size == 0) throw Error({.what = "the WebP encoder failed"});
  Bytes bytes(data, data + size);
  WebPFree(data);
  return bytes;
}

}  // namespace nadir
