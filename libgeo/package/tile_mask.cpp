#include "package/tile_mask.hpp"

#include <algorithm>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"

namespace nadir {
namespace {

constexpr std::size_t kPixels = static_cast<std::size_t>(kTileSize) * kTileSize;

}  // namespace

std::optional<Bytes> decode_tile_mask(ByteView png) {
  if (sniff_image_format(png) != ImageFormat::png) return std::nullopt;
  try {
    const ImageInfo info = read_image_info(png, "mask");
    if (info.width != kTileSize || info.height != kTileSize || info.colour || info.alpha) return std::nullopt;
    const cv::Mat image = decode_image(png, Colour::grey, "mask").image;
    if (!image.isContinuous() || image.total() != kPixels || image.type() != CV_8UC1) return std::nullopt;
    return Bytes(image.data, image.data + kPixels);
  } catch (const Error&) {
    return std::nullopt;
  }
}

Bytes encode_tile_mask(ByteView pixels) {
  if (pixels.size() != kPixels) throw Error({.what = "a tile mask has another size than a tile"});
  cv::Mat image(kTileSize, kTileSize, CV_8UC1);
  std::copy(pixels.begin(), pixels.end(), image.data);
  return encode_image(image, ImageFormat::png);
}

}  // namespace nadir
