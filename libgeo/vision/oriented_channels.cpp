#include "vision/oriented_channels.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

namespace nadir {
namespace {

constexpr int kOrientations = 6;

ImageGradient smoothed_gradient(const cv::Mat& grey, double sigma_px) {
  cv::Mat smooth;
  grey.convertTo(smooth, CV_32F);
  cv::GaussianBlur(smooth, smooth, cv::Size(), sigma_px, sigma_px, cv::BORDER_REFLECT_101);
  return image_gradient(smooth);
}

// 1 / (local strength + floor): equalises the contrast over the image.
cv::Mat normalisation(const cv::Mat& strength, const cv::Mat& mask, const ChannelOptions& options) {
  const double mean = cv::mean(strength, mask)[0];
  cv::Mat local;
  cv::GaussianBlur(strength, local, cv::Size(), options.pool_px, options.pool_px, cv::BORDER_REFLECT_101);
  cv::Mat factor;
  cv::divide(1.0, local + cv::Scalar(options.floor_fraction * mean + kStrengthEpsilon), factor);
  return factor;
}

cv::Mat double_angle_pair(const ImageGradient& g, const cv::Mat& strength, const cv::Mat& factor) {
  cv::Mat pair(g.x.size(), CV_32FC2);
  for (int r = 0; r < pair.rows; ++r) {
    const auto *gx = g.x.ptr<float>(r), *gy = g.y.ptr<float>(r), *s = strength.ptr<float>(r), *f = factor.ptr<float>(r);
    auto* out = pair.ptr<float>(r);
    for (std::size_t c = 0; c < static_cast<std::size_t>(pair.cols); ++c) {
      const float weight = f[c] / (s[c] + kGradientEpsilon);  // (x² − y², 2xy) / |g| is |g| at twice the angle
      out[2 * c] = (gx[c] * gx[c] - gy[c] * gy[c]) * weight;
      out[2 * c + 1] = 2 * gx[c] * gy[c] * weight;
    }
  }
  return pair;
}

// Strength times the squared half-wave rectified cosine of twice the angle to each orientation: wide, overlapping bins.
std::vector<cv::Mat> orientation_pairs(const ImageGradient& g, const cv::Mat& strength, const cv::Mat& factor) {
  constexpr std::size_t kPairs = kOrientations / 2;
  std::array<float, kPairs> cosine{}, sine{};
  for (std::size_t p = 0; p < kPairs; ++p) {
    const double twice = 2.0 * std::numbers::pi * static_cast<double>(p) / kOrientations;
    cosine[p] = static_cast<float>(std::cos(twice));
    sine[p] = static_cast<float>(std::sin(twice));
  }
  std::vector<cv::Mat> pairs(kPairs);
  for (cv::Mat& pair : pairs) pair.create(g.x.size(), CV_32FC2);
  const auto columns = static_cast<std::size_t>(g.x.cols);
  std::vector<float> weight(columns), c2(columns), s2(columns);
  for (int r = 0; r < g.x.rows; ++r) {
    const auto *gx = g.x.ptr<float>(r), *gy = g.y.ptr<float>(r), *s = strength.ptr<float>(r), *f = factor.ptr<float>(r);
    for (std::size_t c = 0; c < columns; ++c) {
      const float x2 = gx[c] * gx[c], y2 = gy[c] * gy[c];
      const float inverse = 1.0F / (x2 + y2 + kGradientEpsilon2);
      weight[c] = s[c] * f[c];
      c2[c] = (x2 - y2) * inverse;
      s2[c] = 2 * gx[c] * gy[c] * inverse;
    }
    for (std::size_t p = 0; p < kPairs; ++p) {
      auto* out = pairs[p].ptr<float>(r);
      for (std::size_t c = 0; c < columns; ++c) {
        // Perpendicular orientations share a pair: the cosine of the one is the other's, negated.
        const float along = c2[c] * cosine[p] + s2[c] * sine[p];
        const float a = std::max(0.0F, along), b = std::max(0.0F, -along);
        out[2 * c] = weight[c] * a * a;
        out[2 * c + 1] = weight[c] * b * b;
      }
    }
  }
  return pairs;
}

cv::Mat single_channel_pair(const cv::Mat& channel) {
  cv::Mat pair;
  cv::merge(std::vector<cv::Mat>{channel, cv::Mat::zeros(channel.size(), CV_32FC1)}, pair);
  return pair;
}

template <std::size_t kChannels>
void clear_row(float* value, const std::uint8_t* valid, std::size_t columns) {
  for (std::size_t c = 0; c < columns; ++c) {
    for (std::size_t k = 0; k < kChannels; ++k) {
      value[c * kChannels + k] = valid[c] != 0 ? value[c * kChannels + k] : 0.0F;
    }
  }
}

// Clears what the mask excludes. In the map there is usually nothing to do.
void clear_outside(cv::Mat& values, const cv::Mat& mask, bool whole) {
  if (whole) return;
  const auto clear = values.channels() == 1 ? clear_row<1> : clear_row<2>;
  for (int r = 0; r < values.rows; ++r) {
    clear(values.ptr<float>(r), mask.ptr<std::uint8_t>(r), static_cast<std::size_t>(values.cols));
  }
}

}  // namespace

ImageGradient image_gradient(const cv::Mat& image) {
  ImageGradient gradient;
  cv::Sobel(image, gradient.x, CV_32F, 1, 0, 3, 1.0 / 8);
  cv::Sobel(image, gradient.y, CV_32F, 0, 1, 3, 1.0 / 8);
  return gradient;
}

cv::Mat usable_part(const cv::Mat& mask, cv::Size size, const ChannelOptions& options) {
  cv::Mat usable = mask.empty() ? cv::Mat(size, CV_8UC1, cv::Scalar(255)) : mask.clone();
  if (cv::countNonZero(usable) == static_cast<int>(usable.total())) return usable;
  const int side = 2 * static_cast<int>(std::ceil(2 * options.sigma_px + 1)) + 1;
  cv::erode(usable, usable, cv::getStructuringElement(cv::MORPH_RECT, cv::Size(side, side)), cv::Point(-1, -1), 1,
            cv::BORDER_CONSTANT, cv::Scalar(255));
  return usable;
}

Channels oriented_channels(const cv::Mat& grey, const cv::Mat& mask, ChannelSet set, const ChannelOptions& options) {
  Channels channels;
  channels.mask = usable_part(mask, grey.size(), options);
  channels.means_removed = options.means_removed;
  if (set == ChannelSet::grey) {
    cv::Mat level;
    grey.convertTo(level, CV_32F, 1.0 / 128);  // of the order of 1, as the other channels
    cv::GaussianBlur(level, level, cv::Size(), options.sigma_px, options.sigma_px, cv::BORDER_REFLECT_101);
    channels.pairs.push_back(single_channel_pair(level));
    return channels;
  }
  const bool whole = cv::countNonZero(channels.mask) == static_cast<int>(channels.mask.total());
  const ImageGradient gradient = smoothed_gradient(grey, options.sigma_px);
  cv::Mat strength;
  cv::magnitude(gradient.x, gradient.y, strength);
  clear_outside(strength, channels.mask, whole);
  const cv::Mat factor = normalisation(strength, channels.mask, options);
  if (set == ChannelSet::double_angle) {
    channels.pairs.push_back(double_angle_pair(gradient, strength, factor));
  } else if (set == ChannelSet::strength) {
    channels.pairs.push_back(single_channel_pair(strength.mul(factor)));
  } else {
    channels.pairs = orientation_pairs(gradient, strength, factor);
  }
  for (cv::Mat& pair : channels.pairs) {
    clear_outside(pair, channels.mask, whole);  // else the border of the valid area is smoothed inwards
    cv::GaussianBlur(pair, pair, cv::Size(), options.sigma_px, options.sigma_px, cv::BORDER_REFLECT_101);
    clear_outside(pair, channels.mask, whole);
  }
  return channels;
}

}  // namespace nadir
