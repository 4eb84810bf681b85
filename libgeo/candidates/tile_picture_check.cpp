#include "candidates/tile_picture_check.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"

namespace nadir {
namespace {

constexpr double kPpm = 1e6;
constexpr int kBlur_px = 5;

// Mean length of the gradient, from differences of neighbours.
double mean_gradient(const cv::Mat& grey) {
  double sum = 0;
  for (int row = 0; row + 1 < grey.rows; ++row) {
    const std::uint8_t* here = grey.ptr<std::uint8_t>(row);
    const std::uint8_t* below = grey.ptr<std::uint8_t>(row + 1);
    for (int column = 0; column + 1 < grey.cols; ++column) {
      const double right = here[column + 1] - here[column], down = below[column] - here[column];
      sum += std::sqrt(right * right + down * down);
    }
  }
  return sum / (static_cast<double>(grey.rows - 1) * (grey.cols - 1));
}

}  // namespace

std::variant<cv::Mat, Refusal> read_candidate_picture(ByteView bytes, const CandidateSidecar& sidecar) {
  const auto unsupported = [](std::string detail) {
    return Refusal{.code = ReasonCode::format_unsupported, .detail = std::move(detail)};
  };
  try {
    const ImageInfo info = read_image_info(bytes, "tile");
    if (info.format != sidecar.format) {
      return unsupported(fmt::format("a {} that says it is {}", name_of(info.format), name_of(sidecar.format)));
    }
    if (info.width != kTileSize || info.height != kTileSize) {
      return unsupported(
          fmt::format("{} x {} pixels; tiles have {} x {}", info.width, info.height, kTileSize, kTileSize));
    }
    const DecodedImage decoded = decode_image(bytes, Colour::grey, "tile");
    if (!decoded.alpha.empty() && cv::countNonZero(decoded.alpha != 255) > 0) {
      return unsupported("it is transparent in places; whole tiles are taken");
    }
    return decoded.image;
  } catch (const Error& error) {
    return unsupported("no sound picture: " + error.text().what);
  }
}

PictureFigures picture_figures(const cv::Mat& grey) {
  cv::Scalar mean, deviation;
  cv::meanStdDev(grey, mean, deviation);
  const int clipped = cv::countNonZero(grey == 0) + cv::countNonZero(grey == 255);
  cv::Mat blurred;
  cv::blur(grey, blurred, {kBlur_px, kBlur_px});
  const double before = mean_gradient(grey), after = mean_gradient(blurred);
  return {.contrast_ppm = std::lround(deviation[0] / 255 * kPpm),
          .sharpness_ppm = before > 0 ? std::lround(std::max(0.0, 1 - after / before) * kPpm) : 0,
          .clipped_ppm = std::lround(static_cast<double>(clipped) / static_cast<double>(grey.total()) * kPpm)};
}

std::optional<Refusal> judge_figures(const PictureFigures& figures, const CandidateRules& rules) {
  if (figures.contrast_ppm < rules.min_contrast_ppm) {
    return Refusal{.code = ReasonCode::low_texture,
                   .detail = fmt::format("contrast {} ppm; at least {}", figures.contrast_ppm, rules.min_contrast_ppm)};
  }
  if (figures.clipped_ppm > rules.max_clipped_ppm) {
    return Refusal{.code = ReasonCode::low_texture,
                   .detail = fmt::format("{} ppm of the pixels are black or blown out; at most {}", figures.clipped_ppm,
                                         rules.max_clipped_ppm)};
  }
  if (figures.sharpness_ppm < rules.min_sharpness_ppm) {
    return Refusal{
        .code = ReasonCode::blurred,
        .detail = fmt::format("sharpness {} ppm; at least {}", figures.sharpness_ppm, rules.min_sharpness_ppm)};
  }
  return std::nullopt;
}

}  // namespace nadir
