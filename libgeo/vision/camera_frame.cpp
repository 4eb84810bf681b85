#include "vision/camera_frame.hpp"

#include <algorithm>
#include <cstring>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"
#include "imagery/frame_image.hpp"
#include "vision/oriented_channels.hpp"

namespace nadir {
namespace {

// FNV-1a over words of eight bytes: quick, and a collision of two noisy frames is practically impossible.
std::uint64_t fingerprint(const cv::Mat& frame) {
  constexpr std::uint64_t kPrime = 0x100000001b3;
  std::uint64_t hash = 0xcbf29ce484222325 ^ static_cast<std::uint64_t>(frame.cols);
  const std::size_t bytes = static_cast<std::size_t>(frame.cols) * frame.elemSize();
  for (int row = 0; row < frame.rows; ++row) {
    const auto* at = frame.ptr<std::uint8_t>(row);
    std::size_t i = 0;
    for (; i + 8 <= bytes; i += 8) {
      std::uint64_t word = 0;
      std::memcpy(&word, at + i, 8);
      hash = (hash ^ word) * kPrime;
      hash ^= hash >> 29;
    }
    for (; i < bytes; ++i) hash = (hash ^ at[i]) * kPrime;
  }
  return hash;
}

}  // namespace

int decode_reduction(int width, int height) {
  constexpr int kLargest = 8;  // that JPEG decoders reduce by
  int reduction = 1;
  while (reduction < kLargest && std::max(width, height) / (2 * reduction) >= kMinDecodedSide_px &&
         width % (2 * reduction) == 0 && height % (2 * reduction) == 0) {
    reduction *= 2;
  }
  return reduction;
}

cv::Mat decode_camera_frame(ByteView encoded, const CameraModel& camera, int reduction, const DecodeBudget& budget) {
  const auto reduced = [reduction](int side) { return (side + reduction - 1) / reduction; };
  try {
    const FrameSize info = read_frame_size(encoded, "frame");
    if (reduced(info.width) != camera.width || reduced(info.height) != camera.height) return {};
    return decode_frame(encoded, Colour::grey, "frame", reduction, budget);
  } catch (const Error&) {
    return {};
  }
}

FrameQuality measure_frame_quality(const cv::Mat& grey, const QualityLimits& limits) {
  FrameQuality quality;
  if (grey.empty()) return quality;
  cv::Mat small;
  const double factor = kQualityWidth_px / std::max(grey.cols, grey.rows);
  cv::resize(grey, small, cv::Size(), factor, factor, factor < 1 ? cv::INTER_AREA : cv::INTER_LINEAR);
  cv::Mat coarse;
  const double coarser = kContrastWidth_px / kQualityWidth_px;
  const auto coarse_side = [coarser](int side) { return std::max(1, cvRound(coarser * side)); };
  cv::resize(small, coarse, cv::Size(coarse_side(small.cols), coarse_side(small.rows)), 0, 0, cv::INTER_AREA);
  cv::Scalar mean, deviation, coarse_deviation;
  cv::meanStdDev(small, mean, deviation);
  cv::meanStdDev(coarse, {}, coarse_deviation);
  quality.mean = mean[0];
  quality.contrast = coarse_deviation[0];
  const int clipped = cv::countNonZero(small <= kClippedDark) + cv::countNonZero(small >= kClippedBright);
  quality.clipped_share = clipped / static_cast<double>(small.total());
  const ImageGradient gradient = image_gradient(small);
  cv::Mat strength;
  cv::magnitude(gradient.x, gradient.y, strength);
  quality.sharpness = deviation[0] > 0 ? cv::mean(strength)[0] / deviation[0] : 0;
  quality.usable = quality.contrast >= limits.min_contrast && quality.clipped_share <= limits.max_clipped_share &&
                   quality.sharpness >= limits.min_sharpness;
  return quality;
}

bool FrozenFrameDetector::repeats(const cv::Mat& frame) {
  if (frame.empty()) return false;
  const std::uint64_t now = fingerprint(frame);
  const bool same = last_ == now;
  last_ = now;
  return same;
}

namespace {

class ImageFrameChecker final : public FrameChecker {
 public:
  FrameCheck check(const cv::Mat& grey) override {
    FrameCheck found;
    found.sharp = measure_frame_quality(grey).usable;
    found.repeated = found.sharp && frozen_.repeats(grey);
    return found;
  }

 private:
  FrozenFrameDetector frozen_;
};

}  // namespace

std::unique_ptr<FrameChecker> make_frame_checker() { return std::make_unique<ImageFrameChecker>(); }

}  // namespace nadir
