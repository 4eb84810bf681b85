#include "imagery/codecs.hpp"

#include <cstddef>
#include <cstdio>
//
#include <fmt/format.h>
#include <jerror.h>
#include <jpeglib.h>
#include <png.h>
#include <webp/decode.h>
#include <webp/encode.h>

#include <array>
#include <csetjmp>
#include <cstdlib>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"
#include "base/files.hpp"

namespace nadir {
namespace {

[[noreturn]] void reject(std::string_view name, std::string_view format, std::string_view found) {
  throw Error({.what = "cannot decode the image",
               .where = std::string(name),
               .expected = fmt::format("a complete {} image", format),
               .found = std::string(found),
               .fix = "copy or create the file again"});
}

void check_size(std::int64_t width, std::int64_t height, std::string_view name) {
  if (width < 1 || height < 1 || width > kMaxImageSide || height > kMaxImageSide || width * height > kMaxImagePixels) {
    throw Error({.what = "the image size is out of range",
                 .where = std::string(name),
                 .expected = fmt::format("1 to {} pixels a side and at most {} in all", kMaxImageSide, kMaxImagePixels),
                 .found = fmt::format("{} x {}", width, height),
                 .fix = "cut large rasters into map tiles instead of reading them as one image"});
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

// libjpeg reports errors by calling a function that must not return. It longjmps here, so the functions that call
// libjpeg hold nothing that needs a destructor: they work on plain structs that the callers own.
namespace jpeg {

struct ErrorManager {
  jpeg_error_mgr base{};
  std::jmp_buf back{};
  std::array<char, JMSG_LENGTH_MAX> message{};
};

ErrorManager& manager_of(j_common_ptr info) { return *reinterpret_cast<ErrorManager*>(info->err); }

[[noreturn]] void on_error(j_common_ptr info) {
  ErrorManager& manager = manager_of(info);
  manager.base.format_message(info, manager.message.data());
  std::longjmp(manager.back, 1);
}

// Warnings mean that libjpeg made up pixels (truncated or damaged data), but for a few that are harmless.
void on_message(j_common_ptr info, int level) {
  if (level >= 0) return;
  const int code = info->err->msg_code;
  if (code == JWRN_EXTRANEOUS_DATA || code == JWRN_ADOBE_XFORM || code == JWRN_JFIF_MAJOR) return;
  on_error(info);
}

void set_up(ErrorManager& manager) {
  jpeg_std_error(&manager.base);
  manager.base.error_exit = on_error;
  manager.base.emit_message = on_message;
}

// What libjpeg is asked while it decodes, at least once for each row of blocks and for each scan.
struct Overseer {
  jpeg_progress_mgr base{};
  const DecodeBudget* budget = nullptr;
  std::int64_t deadline_ms = 0;
};

void oversee(j_common_ptr info) {
  const Overseer& overseer = *reinterpret_cast<Overseer*>(info->progress);
  const DecodeBudget& budget = *overseer.budget;
  const int scans = reinterpret_cast<j_decompress_ptr>(info)->input_scan_number;
  const char* fault = scans > budget.max_scans                                       ? "too many scans"
                      : budget.limit_ms > 0 && budget.clock() > overseer.deadline_ms ? "too much work for its size"
                                                                                     : nullptr;
  if (fault == nullptr) return;
  ErrorManager& manager = manager_of(info);
  std::snprintf(manager.message.data(), manager.message.size(), "%s", fault);
  std::longjmp(manager.back, 1);
}

struct Decoder {
  jpeg_decompress_struct info{};
  ErrorManager errors;
  Overseer overseer;

  Decoder() { info.err = (set_up(errors), &errors.base); }
  ~Decoder() { jpeg_destroy_decompress(&info); }
  Decoder(const Decoder&) = delete;
  Decoder& operator=(const Decoder&) = delete;
};

bool read_header(Decoder& decoder, ByteView bytes) {
  if (setjmp(decoder.errors.back) != 0) return false;
  jpeg_create_decompress(&decoder.info);
  jpeg_mem_src(&decoder.info, bytes.data(), bytes.size());
  return jpeg_read_header(&decoder.info, TRUE) == JPEG_HEADER_OK;
}

bool start(Decoder& decoder, J_COLOR_SPACE space, unsigned shrink) {
  if (setjmp(decoder.errors.back) != 0) return false;
  decoder.info.out_color_space = space;
  decoder.info.scale_num = 1;
  decoder.info.scale_denom = shrink;
  return jpeg_start_decompress(&decoder.info) == TRUE;
}

bool read_rows(Decoder& decoder, JSAMPLE* pixels, std::size_t row_bytes) {
  if (setjmp(decoder.errors.back) != 0) return false;
  while (decoder.info.output_scanline < decoder.info.output_height) {
    std::array<JSAMPROW, 8> rows{};
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const std::size_t row = std::min<std::size_t>(decoder.info.output_scanline + i, decoder.info.output_height - 1);
      rows[i] = pixels + row * row_bytes;
    }
    const JDIMENSION left = decoder.info.output_height - decoder.info.output_scanline;
    jpeg_read_scanlines(&decoder.info, rows.data(), std::min<JDIMENSION>(left, rows.size()));
  }
  return jpeg_finish_decompress(&decoder.info) == TRUE;
}

void open(Decoder& decoder, ByteView bytes, std::string_view name) {
  if (!read_header(decoder, bytes)) reject(name, "JPEG", decoder.errors.message.data());
  check_size(decoder.info.image_width, decoder.info.image_height, name);
  if (decoder.info.jpeg_color_space == JCS_CMYK || decoder.info.jpeg_color_space == JCS_YCCK) {
    reject(name, "grey or colour JPEG", "CMYK");
  }
  if (decoder.info.num_components != 1 && decoder.info.num_components != 3) {
    reject(name, "grey or colour JPEG", fmt::format("{} components", decoder.info.num_components));
  }
}

struct Encoder {
  jpeg_compress_struct info{};
  ErrorManager errors;
  unsigned char* data = nullptr;  // libjpeg allocates it with malloc
  unsigned long size = 0;

  Encoder() { info.err = (set_up(errors), &errors.base); }
  ~Encoder() {
    jpeg_destroy_compress(&info);
    std::free(data);
  }
  Encoder(const Encoder&) = delete;
  Encoder& operator=(const Encoder&) = delete;
};

bool compress(Encoder& encoder, const cv::Mat& image, int quality) {
  if (setjmp(encoder.errors.back) != 0) return false;
  jpeg_compress_struct& info = encoder.info;
  jpeg_create_compress(&info);
  jpeg_mem_dest(&info, &encoder.data, &encoder.size);
  info.image_width = static_cast<JDIMENSION>(image.cols);
  info.image_height = static_cast<JDIMENSION>(image.rows);
  info.input_components = image.channels();
  info.in_color_space = image.channels() == 1 ? JCS_GRAYSCALE : JCS_EXT_BGR;
  jpeg_set_defaults(&info);  // for colour: YCbCr 4:2:0
  jpeg_set_quality(&info, quality, TRUE);
  info.optimize_coding = TRUE;  // own Huffman tables: map tiles get 10 % smaller for 10 % more time
  jpeg_start_compress(&info, TRUE);
  while (info.next_scanline < info.image_height) {
    // libjpeg's interface is older than const; it does not write through this pointer.
    auto* row = const_cast<JSAMPLE*>(image.ptr<JSAMPLE>(static_cast<int>(info.next_scanline)));
    jpeg_write_scanlines(&info, &row, 1);
  }
  jpeg_finish_compress(&info);
  return true;
}

ImageInfo info(ByteView bytes, std::string_view name) {
  Decoder decoder;
  open(decoder, bytes, name);
  return {ImageFormat::jpeg, static_cast<int>(decoder.info.image_width), static_cast<int>(decoder.info.image_height),
          decoder.info.num_components > 1, false};
}

DecodedImage decode(ByteView bytes, Colour colour, std::string_view name, int shrink, const DecodeBudget& budget) {
  Decoder decoder;
  open(decoder, bytes, name);
  decoder.overseer.base.progress_monitor = oversee;
  decoder.overseer.budget = &budget;
  if (budget.limit_ms > 0) decoder.overseer.deadline_ms = budget.clock() + budget.limit_ms;
  decoder.info.progress = &decoder.overseer.base;
  const bool grey = colour == Colour::grey;
  if (!start(decoder, grey ? JCS_GRAYSCALE : JCS_EXT_BGR, static_cast<unsigned>(shrink))) {
    reject(name, "JPEG", decoder.errors.message.data());
  }
  cv::Mat image(static_cast<int>(decoder.info.output_height), static_cast<int>(decoder.info.output_width),
                grey ? CV_8UC1 : CV_8UC3);
  if (!read_rows(decoder, image.data, image.step)) reject(name, "JPEG", decoder.errors.message.data());
  return {image, {}};
}

Bytes encode(const cv::Mat& image, int quality) {
  Encoder encoder;
  if (!compress(encoder, image, quality)) {
    throw Error({.what = "the JPEG encoder failed", .found = encoder.errors.message.data()});
  }
  return {encoder.data, encoder.data + encoder.size};
}

}  // namespace jpeg

namespace png {

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
  if (!is_whole(bytes)) reject(name, "PNG", "a truncated file");
}

ImageInfo info(ByteView bytes, std::string_view name) {
  Png png;
  open(png, bytes, name);
  return {ImageFormat::png, static_cast<int>(png.image.width), static_cast<int>(png.image.height),
          (png.image.format & PNG_FORMAT_FLAG_COLOR) != 0, (png.image.format & PNG_FORMAT_FLAG_ALPHA) != 0};
}

DecodedImage decode(ByteView bytes, Colour colour, std::string_view name) {
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

Bytes encode(const cv::Mat& image) {
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

}  // namespace png

namespace webp {

const char* text_of(VP8StatusCode code) {
  switch (code) {
    case VP8_STATUS_NOT_ENOUGH_DATA: return "a truncated file";
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

ImageInfo info(ByteView bytes, std::string_view name) {
  const WebPBitstreamFeatures features = features_of(bytes, name);
  return {ImageFormat::webp, features.width, features.height, true, features.has_alpha != 0};
}

DecodedImage decode(ByteView bytes, Colour colour, std::string_view name) {
  const WebPBitstreamFeatures features = features_of(bytes, name);
  const bool alpha = features.has_alpha != 0;
  cv::Mat pixels(features.height, features.width, alpha ? CV_8UC4 : CV_8UC3);
  WebPDecoderConfig config;
  if (WebPInitDecoderConfig(&config) == 0) {
    throw Error({.what = "libwebp has another version than the one this program was built with",
                 .where = std::string(name),
                 .fix = "install libwebp of the version that the package depends on, or build Nadir again"});
  }
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

Bytes encode(const cv::Mat& image, int quality) {
  cv::Mat colour = image;
  if (image.channels() == 1) {
    const cv::Mat channels[] = {image, image, image};
    cv::merge(channels, 3, colour);
  }
  std::uint8_t* data = nullptr;
  const auto compress = colour.channels() == 4 ? WebPEncodeBGRA : WebPEncodeBGR;
  const std::size_t size = compress(colour.data, colour.cols, colour.rows, static_cast<int>(colour.step),
                                    static_cast<float>(quality), &data);
  if (size == 0) throw Error({.what = "the WebP encoder failed"});
  Bytes bytes(data, data + size);
  WebPFree(data);
  return bytes;
}

}  // namespace webp

bool begins_with(ByteView bytes, std::string_view magic, std::size_t at = 0) {
  return bytes.size() >= at + magic.size() && as_text(bytes.subspan(at, magic.size())) == magic;
}

ImageFormat format_of(ByteView bytes, std::string_view name) {
  const auto format = sniff_image_format(bytes);
  if (!format) reject(name, "JPEG, PNG or WebP", bytes.empty() ? "no bytes" : "bytes of a different kind");
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
    case ImageFormat::jpeg: return jpeg::info(bytes, name);
    case ImageFormat::png: return png::info(bytes, name);
    case ImageFormat::webp: return webp::info(bytes, name);
  }
  return {};
}

DecodedImage decode_image(ByteView bytes, Colour colour, std::string_view name, int shrink,
                          const DecodeBudget& budget) {
  if (shrink != 1 && shrink != 2 && shrink != 4 && shrink != 8) {
    throw UsageError({.what = "images can be reduced by 1, 2, 4 or 8", .found = std::to_string(shrink)});
  }
  const ImageFormat format = format_of(bytes, name);
  if (format == ImageFormat::jpeg) return jpeg::decode(bytes, colour, name, shrink, budget);
  DecodedImage whole =
      format == ImageFormat::png ? png::decode(bytes, colour, name) : webp::decode(bytes, colour, name);
  return {shrunk(whole.image, shrink), shrunk(whole.alpha, shrink)};
}

cv::Mat read_image_file(const std::filesystem::path& path, Colour colour, int shrink) {
  constexpr std::uint64_t kMaxFileSize = std::uint64_t{1} << 30;
  return decode_image(read_file(path, kMaxFileSize), colour, path.string(), shrink).image;
}

Bytes encode_image(const cv::Mat& image, ImageFormat format, int quality) {
  check_size(image.cols, image.rows, "image to encode");
  if (image.depth() != CV_8U || image.channels() == 2 || (format == ImageFormat::jpeg && image.channels() == 4)) {
    throw Error({.what = "this image cannot be encoded",
                 .expected = "8 bit grey or BGR (BGRA for PNG and WebP)",
                 .found = fmt::format("{} channels of type {}", image.channels(), image.depth())});
  }
  if (quality < 1 || quality > 100) {
    throw UsageError({.what = "the quality is out of range", .expected = "1 to 100", .found = std::to_string(quality)});
  }
  switch (format) {
    case ImageFormat::jpeg: return jpeg::encode(image, quality);
    case ImageFormat::png: return png::encode(image);
    case ImageFormat::webp: return webp::encode(image, quality);
  }
  return {};
}

bool is_lossless_webp(ByteView bytes) {
  WebPBitstreamFeatures features;
  constexpr int kLossless = 2;
  return WebPGetFeatures(bytes.data(), bytes.size(), &features) == VP8_STATUS_OK && features.format == kLossless;
}

Bytes encode_lossless_webp(const cv::Mat& image) {
  if (image.type() != CV_8UC3) throw Error({.what = "lossless WebP needs a BGR image"});
  std::uint8_t* data = nullptr;
  const std::size_t size =
      WebPEncodeLosslessBGR(image.data, image.cols, image.rows, static_cast<int>(image.step), &data);
  if (size == 0) throw Error({.what = "the WebP encoder failed"});
  Bytes bytes(data, data + size);
  WebPFree(data);
  return bytes;
}

}  // namespace nadir
