#include "imagery/lossless_webp.hpp"

#include <webp/decode.h>
#include <webp/encode.h>

#include "base/error.hpp"

namespace nadir {

bool is_lossless_webp(ByteView bytes) {
  WebPBitstreamFeatures features;
  constexpr int kLossless = 2;
  return WebPGetFeatures(bytes.data(), bytes.size(), &features) == VP8_STATUS_OK && features.format == kLossless;
}

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
