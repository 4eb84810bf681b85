#include "package/tile_picture.hpp"

#include <fmt/format.h>

#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "imagery/codecs.hpp"
#include "package/sidecar.hpp"
#include "package/tile_fill.hpp"
#include "package/tile_set_check.hpp"

namespace nadir {
namespace {

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
          .expected = "a picture of the ground",
          .found = std::move(found),
          .fix = "look at this tile: fill that was written as a tile is no coverage"};
}

void leave_out(const cv::Mat& fill, const TileKey& key, TilePicture& picture) {
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
                            .fix = "fill is no coverage: use a format with transparency, or imagery beyond the area"};
}

}  // namespace

TilePicture inspect_tile(ByteView tile, const TileKey& key) {
  TilePicture result;
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
      result.problem = blank(key, fill ? Severity::refuse : Severity::warning,
                             fill ? "one colour throughout: black or white fill" : "one colour throughout");
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
                             .expected = "a sound picture",
                             .found = error.text().found.empty() ? error.text().what : error.text().found};
  }
  return result;
}

}  // namespace nadir
