// Encoded images to pixels and back: JPEG, PNG and WebP through their own libraries.
//
// Bytes from outside are not trusted: the declared size is checked before anything is allocated, truncated or damaged
// data is an Error, never a partial image, and what decoding may cost is bounded: a progressive JPEG of a few hundred
// kilobytes can ask for its image to be refined 100 000 times. A camera's JPEG that is needed at a reduced size is
// decoded at that size (scaled inverse DCT), at a fraction of the cost.
#pragma once

#include <cstdint>
#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string_view>

#include "base/bytes.hpp"
#include "base/monotonic.hpp"

namespace nadir {

// The two forms in which images are held: one grey channel, or blue, green, red. 8 bit each.
enum class Colour { grey, bgr };

enum class ImageFormat { jpeg, png, webp };

std::string_view name_of(ImageFormat format);  // "jpeg", "png", "webp"
std::optional<ImageFormat> parse_image_format(std::string_view name);
std::optional<ImageFormat> sniff_image_format(ByteView bytes);  // by the first bytes

inline constexpr int kMaxImageSide = 20'000;
inline constexpr std::int64_t kMaxImagePixels = 400'000'000;

struct ImageInfo {
  ImageFormat format = ImageFormat::jpeg;
  int width = 0;
  int height = 0;
  bool colour = true;
  bool alpha = false;
};

struct DecodedImage {
  cv::Mat image;  // CV_8UC1 or CV_8UC3 (BGR), as asked
  cv::Mat alpha;  // CV_8UC1, 255 = opaque; empty for images without transparency
};

// Header only. All of these throw Error naming `name` (a file, a tile) for anything but a complete image.
ImageInfo read_image_info(ByteView bytes, std::string_view name);

struct DecodeBudget {
  int max_scans = 100;  // of a progressive JPEG; encoders write 10
  std::int64_t limit_ms =
      0;  // 0: without limit. Checked while a JPEG is decoded; PNG and WebP are bounded by their size
  MonotonicMs clock = steady_clock_ms;
};

// shrink: 1, 2, 4 or 8; the result has ceil(side / shrink) pixels.
DecodedImage decode_image(ByteView bytes, Colour colour, std::string_view name, int shrink = 1,
                          const DecodeBudget& budget = {});
cv::Mat read_image_file(const std::filesystem::path& path, Colour colour, int shrink = 1);

// image: CV_8UC1, CV_8UC3 (BGR) or, but for JPEG, CV_8UC4 (BGRA). quality: 1 to 100, for JPEG (4:2:0) and WebP; PNG is
// lossless. The same image gives the same bytes.
Bytes encode_image(const cv::Mat& image, ImageFormat format, int quality = 75);

// Lossless WebP: what a COG holds where an MBTiles file would hold PNG (TIFF knows WebP, but not PNG).
// image: CV_8UC3 (BGR). The same image gives the same bytes.
Bytes encode_lossless_webp(const cv::Mat& image);

// Whether the bytes are such an image; false for anything else.
bool is_lossless_webp(ByteView bytes);

}  // namespace nadir
