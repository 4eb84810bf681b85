#include "imagery/codecs.hpp"

#include <fmt/format.h>

#include <opencv2/imgproc.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "imagery/codec_parts.hpp"

namespace nadir {
namespace codec {

void reject(std::string_view name, std::string_view format, std::string_view found) {
  throw Error({.what = "the picture cannot be decoded",
               .where = std::string(name),
               .expected = fmt::format("a complete {} picture", format),
               .found = std::string(found),
               .fix = "copy or make the file again"});
}

void check_size(std::int64_t width, std::int64_t height, std::string_view name) {
  if (width < 1 || height < 1 || width > kMaxImageSide || height > kMaxImageSide || width * height > kMaxImagePixels) {
    throw Error({.what = "the picture's size is out of range",
                 .where = std::string(name),
                 .expected = fmt::format("1 to {} pixels a side and at most {} in all", kMaxImageSide, kMaxImagePixels),
                 .found = fmt::format("{} x {}", width, height),
                 .fix = "cut large rasters into map tiles instead of reading them as one picture"});
  }
}

DecodedImage split_alpha(const cv::Mat& pixels, Colour colour) {
  DecodedImage result;
  if (pixels.channels() == 4) cv::extractChannel(pixels, result.alpha, 3);
  if (colour == Colour::grey) {
    cv::cvtColor(pixels, result.image, pixels.channels() == 4 ? cv::COLOR_BGRA2GRAY : cv::COLOR_BGR2GRAY);
  } else if (pixels.channels() == 4) {
    cv::cvtColor(pixels, result.image, cv::COLOR_BGRA2BGR);
  } else {
    result.image = pixels;
  }
  return result;
}

}  // namespace codec

namespace {

bool begins_with(ByteView bytes, std::string_view magic, std::size_t at = 0) {
  return bytes.size() >= at + magic.size() && as_text(bytes.subspan(at, magic.size())) == magic;
}

ImageFormat format_of(ByteView bytes, std::string_view name) {
  const auto format = sniff_image_format(bytes);
  if (!format) codec::reject(name, "JPEG, PNG or WebP", bytes.empty() ? "no bytes" : "bytes of another kind");
  return *format;
}

cv::Mat shrunk(const cv::Mat& image, int shrink) {
  if (image.empty() || shrink == 1) return image;
  cv::Mat result;
  const cv::Size size((image.cols + shrink - 1) / shrink, (image.rows + shrink - 1) / shrink);
  cv::resize(image, result, size, 0, 0, cv::INTER_AREA);
  return result;
}

}  // namespace

std::string_view name_of(ImageFormat format) {
  switch (format) {
    case ImageFormat::jpeg: return "jpeg";
    case ImageFormat::png: return "png";
    case ImageFormat::webp: return "webp";
  }
  return "unknown";
}

std::optional<ImageFormat> parse_image_format(std::string_view name) {
  if (name == "jpeg" || name == "jpg") return ImageFormat::jpeg;
  if (name == "png") return ImageFormat::png;
  if (name == "webp") return ImageFormat::webp;
  return std::nullopt;
}

std::optional<ImageFormat> sniff_image_format(ByteView bytes) {
  if (begins_with(bytes, "\xff\xd8\xff")) return ImageFormat::jpeg;
  if (begins_with(bytes, "\x89PNG\r\n\x1a\n")) return ImageFormat::png;
  if (begins_with(bytes, "RIFF") && begins_with(bytes, "WEBP", 8)) return ImageFormat::webp;
  return std::nullopt;
}

ImageInfo read_image_info(ByteView bytes, std::string_view name) {
  switch (format_of(bytes, name)) {
    case ImageFormat::jpeg: return codec::jpeg_info(bytes, name);
    case ImageFormat::png: return codec::png_info(bytes, name);
    case ImageFormat::webp: return codec::webp_info(bytes, name);
  }
  return {};
}

DecodedImage decode_image(ByteView bytes, Colour colour, std::string_view name, int shrink) {
  if (shrink != 1 && shrink != 2 && shrink != 4 && shrink != 8) {
    throw UsageError({.what = "pictures shrink by 1, 2, 4 or 8", .found = std::to_string(shrink)});
  }
  const ImageFormat format = format_of(bytes, name);
  if (format == ImageFormat::jpeg) return codec::decode_jpeg(bytes, colour, name, shrink);
  DecodedImage whole =
      format == ImageFormat::png ? codec::decode_png(bytes, colour, name) : codec::decode_webp(bytes, colour, name);
  return {shrunk(whole.image, shrink), shrunk(whole.alpha, shrink)};
}

cv::Mat read_image_file(const std::filesystem::path& path, Colour colour, int shrink) {
  constexpr std::uint64_t kMaxFileSize = std::uint64_t{1} << 30;
  return decode_image(read_file(path, kMaxFileSize), colour, path.string(), shrink).image;
}

Bytes encode_image(const cv::Mat& image, ImageFormat format, int quality) {
  codec::check_size(image.cols, image.rows, "picture to encode");
  if (image.depth() != CV_8U || image.channels() == 2 || (format == ImageFormat::jpeg && image.channels() == 4)) {
    throw Error({.what = "this picture cannot be encoded",
                 .expected = "8 bit grey or BGR (BGRA for PNG and WebP)",
                 .found = fmt::format("{} channels of type {}", image.channels(), image.depth())});
  }
  if (quality < 1 || quality > 100) {
    throw UsageError({.what = "the quality is out of range", .expected = "1 to 100", .found = std::to_string(quality)});
  }
  switch (format) {
    case ImageFormat::jpeg: return codec::encode_jpeg(image, quality);
    case ImageFormat::png: return codec::encode_png(image);
    case ImageFormat::webp: return codec::encode_webp(image, quality);
  }
  return {};
}

}  // namespace nadir
