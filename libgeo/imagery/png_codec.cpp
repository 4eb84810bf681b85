#include <png.h>

#include "base/error.hpp"
#include "imagery/codec_parts.hpp"

namespace nadir::codec {
namespace {

// libpng stops reading once it has all rows; a file cut off after them is still a damaged file.
bool is_whole(ByteView bytes) {
  std::size_t at = 8;
  while (bytes.size() - at >= 12) {
    const std::size_t length = (std::size_t{bytes[at]} << 24) | (std::size_t{bytes[at + 1]} << 16) |
                               (std::size_t{bytes[at + 2]} << 8) | std::size_t{bytes[at + 3]};
    if (length > bytes.size() - at - 12) return false;
    if (as_text(bytes.subspan(at + 4, 4)) == "IEND") return true;
    at += length + 12;
  }
  return false;
}

struct Png {
  png_image image{};

  Png() { image.version = PNG_IMAGE_VERSION; }
  ~Png() { png_image_free(&image); }
  Png(const Png&) = delete;
  Png& operator=(const Png&) = delete;
};

void open(Png& png, ByteView bytes, std::string_view name) {
  if (png_image_begin_read_from_memory(&png.image, bytes.data(), bytes.size()) == 0) {
    reject(name, "PNG", png.image.message);
  }
  check_size(png.image.width, png.image.height, name);
  if (!is_whole(bytes)) reject(name, "PNG", "a file that ends too early");
}

}  // namespace

ImageInfo png_info(ByteView bytes, std::string_view name) {
  Png png;
  open(png, bytes, name);
  return {ImageFormat::png, static_cast<int>(png.image.width), static_cast<int>(png.image.height),
          (png.image.format & PNG_FORMAT_FLAG_COLOR) != 0, (png.image.format & PNG_FORMAT_FLAG_ALPHA) != 0};
}

DecodedImage decode_png(ByteView bytes, Colour colour, std::string_view name) {
  Png png;
  open(png, bytes, name);
  const bool alpha = (png.image.format & PNG_FORMAT_FLAG_ALPHA) != 0;
  const bool plain_grey = !alpha && (png.image.format & PNG_FORMAT_FLAG_COLOR) == 0 && colour == Colour::grey;
  png.image.format = plain_grey ? PNG_FORMAT_GRAY : alpha ? PNG_FORMAT_BGRA : PNG_FORMAT_BGR;
  cv::Mat pixels(static_cast<int>(png.image.height), static_cast<int>(png.image.width),
                 plain_grey ? CV_8UC1
                 : alpha    ? CV_8UC4
                            : CV_8UC3);
  if (png_image_finish_read(&png.image, nullptr, pixels.data, static_cast<png_int_32>(pixels.step), nullptr) == 0) {
    reject(name, "PNG", png.image.message);
  }
  if (plain_grey) return {pixels, {}};
  return split_alpha(pixels, colour);
}

Bytes encode_png(const cv::Mat& image) {
  Png png;
  png.image.width = static_cast<png_uint_32>(image.cols);
  png.image.height = static_cast<png_uint_32>(image.rows);
  png.image.format = image.channels() == 1 ? PNG_FORMAT_GRAY : image.channels() == 3 ? PNG_FORMAT_BGR : PNG_FORMAT_BGRA;
  Bytes bytes(static_cast<std::size_t>(PNG_IMAGE_PNG_SIZE_MAX(png.image)));
  png_alloc_size_t size = bytes.size();
  if (png_image_write_to_memory(&png.image, bytes.data(), &size, 0, image.data, static_cast<png_int_32>(image.step),
                                nullptr) == 0) {
    throw Error({.what = "the PNG encoder failed", .found = png.image.message});
  }
  bytes.resize(size);
  bytes.shrink_to_fit();
  return bytes;
}

}  // namespace nadir::codec
