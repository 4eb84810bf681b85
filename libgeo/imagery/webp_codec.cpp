#include <webp/decode.h>
#include <webp/encode.h>

#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "imagery/codec_parts.hpp"

namespace nadir::codec {
namespace {

const char* text_of(VP8StatusCode code) {
  switch (code) {
    case VP8_STATUS_NOT_ENOUGH_DATA: return "a file that ends too early";
    case VP8_STATUS_UNSUPPORTED_FEATURE: return "a kind of WebP that is not supported";
    case VP8_STATUS_OUT_OF_MEMORY: return "out of memory";
    default: return "damaged data";
  }
}

WebPBitstreamFeatures features_of(ByteView bytes, std::string_view name) {
  WebPBitstreamFeatures features{};
  const VP8StatusCode code = WebPGetFeatures(bytes.data(), bytes.size(), &features);
  if (code != VP8_STATUS_OK) reject(name, "WebP", text_of(code));
  if (features.has_animation != 0) reject(name, "WebP", "an animation");
  check_size(features.width, features.height, name);
  return features;
}

}  // namespace

ImageInfo webp_info(ByteView bytes, std::string_view name) {
  const WebPBitstreamFeatures features = features_of(bytes, name);
  return {ImageFormat::webp, features.width, features.height, true, features.has_alpha != 0};
}

DecodedImage decode_webp(ByteView bytes, Colour colour, std::string_view name) {
  const WebPBitstreamFeatures features = features_of(bytes, name);
  const bool alpha = features.has_alpha != 0;
  cv::Mat pixels(features.height, features.width, alpha ? CV_8UC4 : CV_8UC3);
  WebPDecoderConfig config;
  if (WebPInitDecoderConfig(&config) == 0) throw Error({.what = "libwebp has another version than its header"});
  config.output.colorspace = alpha ? MODE_BGRA : MODE_BGR;
  config.output.is_external_memory = 1;
  config.output.u.RGBA.rgba = pixels.data;
  config.output.u.RGBA.stride = static_cast<int>(pixels.step);
  config.output.u.RGBA.size = pixels.step * static_cast<std::size_t>(pixels.rows);
  const VP8StatusCode code = WebPDecode(bytes.data(), bytes.size(), &config);
  WebPFreeDecBuffer(&config.output);
  if (code != VP8_STATUS_OK) reject(name, "WebP", text_of(code));
  return split_alpha(pixels, colour);
}

Bytes encode_webp(const cv::Mat& image, int quality) {
  cv::Mat colour = image;
  if (image.channels() == 1) {
    const cv::Mat channels[] = {image, image, image};
    cv::merge(channels, 3, colour);
  }
  std::uint8_t* data = nullptr;
  const auto encode = colour.channels() == 4 ? WebPEncodeBGRA : WebPEncodeBGR;
  const std::size_t size =
      encode(colour.data, colour.cols, colour.rows, static_cast<int>(colour.step), static_cast<float>(quality), &data);
  if (size == 0) throw Error({.what = "the WebP encoder failed"});
  Bytes bytes(data, data + size);
  WebPFree(data);
  return bytes;
}

}  // namespace nadir::codec
