#include "package/tile_image.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <opencv2/core.hpp>
#include <vector>

#include "base/error.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/codecs.hpp"
#include "package/sidecar.hpp"

namespace nadir {
namespace {

constexpr std::size_t kPixels = static_cast<std::size_t>(kTileSize) * kTileSize;

constexpr int kMinFillBlocks = 4;  // fewer are not significant
constexpr int kBlock = 16;         // pixels
constexpr int kBlocks = kTileSize / kBlock;
constexpr double kNear = 3;  // JPEG does not give black and white back exactly

enum class Kind : std::uint8_t { ground, black, white };

Kind kind_of(const cv::Mat& block) {
  double low = 0, high = 0;
  cv::minMaxLoc(block.clone().reshape(1), &low, &high);
  if (high <= kNear) return Kind::black;
  return low >= 255 - kNear ? Kind::white : Kind::ground;
}

// CV_8UC1, 255 where the image (CV_8UC3) is fill; empty when there is none.
cv::Mat edge_fill(const cv::Mat& image) {
  std::array<Kind, kBlocks * kBlocks> kinds{};
  std::array<bool, kBlocks * kBlocks> taken{};
  std::vector<int> open;
  const auto take = [&](int index) {
    const auto at = static_cast<std::size_t>(index);
    if (taken[at] || kinds[at] == Kind::ground) return;
    taken[at] = true;
    open.push_back(index);
  };
  for (int index = 0; index < kBlocks * kBlocks; ++index) {
    const cv::Rect place(index % kBlocks * kBlock, index / kBlocks * kBlock, kBlock, kBlock);
    kinds[static_cast<std::size_t>(index)] = kind_of(image(place));
  }
  for (int i = 0; i < kBlocks; ++i) {
    for (const int edge : {i, (kBlocks - 1) * kBlocks + i, i * kBlocks, i * kBlocks + kBlocks - 1}) take(edge);
  }
  cv::Mat fill(kTileSize, kTileSize, CV_8UC1, cv::Scalar(0));
  int count = 0;
  while (!open.empty()) {
    const int index = open.back();
    open.pop_back();
    ++count;
    const int column = index % kBlocks, row = index / kBlocks;
    fill(cv::Rect(column * kBlock, row * kBlock, kBlock, kBlock)).setTo(255);
    if (column > 0) take(index - 1);
    if (column + 1 < kBlocks) take(index + 1);
    if (row > 0) take(index - kBlocks);
    if (row + 1 < kBlocks) take(index + kBlocks);
  }
  return count >= kMinFillBlocks ? fill : cv::Mat();
}

// The largest difference between two pixels of a channel.
double spread(const cv::Mat& image) {
  double low = 0, high = 0;
  cv::minMaxLoc(image.reshape(1), &low, &high);
  if (image.channels() == 1) return high - low;
  std::vector<cv::Mat> planes;
  cv::split(image, planes);
  double widest = 0;
  for (const cv::Mat& plane : planes) {
    cv::minMaxLoc(plane, &low, &high);
    widest = std::max(widest, high - low);
  }
  return widest;
}

Finding blank(const TileKey& key, Severity severity, std::string found) {
  return {.code = "tile.blank",
          .severity = severity,
          .where = "tile " + to_text(key),
          .expected = "an image of the ground",
          .found = std::move(found),
          .fix = "inspect this tile: fill written as a tile is not coverage"};
}

void leave_out(const cv::Mat& fill, const TileKey& key, TileImageCheck& picture) {
  const auto pixels = static_cast<std::size_t>(fill.total());
  if (picture.mask.empty()) picture.mask.assign(pixels, 255);
  std::int64_t valid = 0, filled = 0;
  for (std::size_t i = 0; i < pixels; ++i) {
    filled += fill.data[i] != 0 && picture.mask[i] != 0 ? 1 : 0;
    if (fill.data[i] != 0) picture.mask[i] = 0;
    valid += picture.mask[i] != 0 ? 1 : 0;
  }
  picture.valid_ppm = valid * kWholeTile_ppm / static_cast<std::int64_t>(pixels);
  if (filled == 0) return;  // transparent already
  picture.problem = Finding{.code = "tile.fill",
                            .severity = Severity::warning,
                            .where = "tile " + to_text(key),
                            .expected = "ground, or transparent where there is none",
                            .found = fmt::format("{} % of it is black or white fill at its edge",
                                                 100 * filled / static_cast<std::int64_t>(pixels)),
                            .fix = "fill is not coverage: use a format with transparency, or imagery beyond the area"};
}

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
  if (pixels.size() != kPixels) throw Error({.what = "tile mask and tile differ in size"});
  cv::Mat image(kTileSize, kTileSize, CV_8UC1);
  std::copy(pixels.begin(), pixels.end(), image.data);
  return encode_image(image, ImageFormat::png);
}

std::optional<Finding> tile_header_problem(ByteView tile, const TileKey& key) {
  const std::string where = "tile " + to_text(key);
  try {
    const ImageInfo info = read_image_info(tile, where);
    if (info.width == kTileSize && info.height == kTileSize) return std::nullopt;
    return Finding{.code = "tile.size",
                   .where = where,
                   .expected = fmt::format("{0} x {0} pixels", kTileSize),
                   .found = fmt::format("{} x {}", info.width, info.height),
                   .fix = "create the tile set with tiles of this size"};
  } catch (const Error& error) {
    return Finding{.code = "tile.undecodable",
                   .where = where,
                   .expected = "a JPEG, PNG or WebP image",
                   .found = error.text().found.empty() ? error.text().what : error.text().found};
  }
}

TileImageCheck check_tile_image(ByteView tile, const TileKey& key) {
  TileImageCheck result;
  result.problem = tile_header_problem(tile, key);
  if (result.problem) return result;
  try {
    const DecodedImage decoded = decode_image(tile, Colour::bgr, "tile " + to_text(key));
    const auto pixels = static_cast<std::int64_t>(decoded.image.total());
    const std::int64_t valid = decoded.alpha.empty() ? pixels : cv::countNonZero(decoded.alpha == 255);
    result.valid_ppm = valid * kWholeTile_ppm / pixels;
    if (valid < pixels) {
      const cv::Mat mask = decoded.alpha == 255;
      result.mask.assign(mask.datastart, mask.dataend);
    }
    if (valid == 0) {
      result.problem = blank(key, Severity::warning, "every pixel is transparent");
    } else if (spread(decoded.image) == 0) {
      const cv::Vec3b colour = decoded.image.at<cv::Vec3b>(0, 0);
      const bool fill = colour == cv::Vec3b(0, 0, 0) || colour == cv::Vec3b(255, 255, 255);
      // Black or white throughout is fill; another single colour may be a lake.
      result.problem = blank(key, fill ? Severity::error : Severity::warning,
                             fill ? "a single colour: black or white fill" : "a single colour");
      if (fill) {
        result.valid_ppm = 0;
        result.mask.assign(static_cast<std::size_t>(pixels), 0);
      }
    } else if (const cv::Mat fill = edge_fill(decoded.image); !fill.empty()) {
      leave_out(fill, key, result);
    }
  } catch (const Error& error) {
    result.problem = Finding{.code = "tile.undecodable",
                             .where = "tile " + to_text(key),
                             .expected = "an intact image",
                             .found = error.text().found.empty() ? error.text().what : error.text().found};
  }
  return result;
}

}  // namespace nadir
