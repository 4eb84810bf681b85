#include "vision/oriented_channels.hpp"

#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

namespace nadir {
namespace {

constexpr int kOrientations = 6;

struct Gradient {
  cv::Mat x, y;  // CV_32FC1
};

Gradient gradient_of(const cv::Mat& grey, double sigma_px) {
  cv::Mat smooth;
  grey.convertTo(smooth, CV_32F);
  cv::GaussianBlur(smooth, smooth, cv::Size(), sigma_px, sigma_px, cv::BORDER_REFLECT_101);
  Gradient gradient;
  cv::Sobel(smooth, gradient.x, CV_32F, 1, 0, 3, 0.125);
  cv::Sobel(smooth, gradient.y, CV_32F, 0, 1, 3, 0.125);
  return gradient;
}

// The Sobel operator and the smoothing reach over the border of the valid area: leave that rim out.
cv::Mat usable_part(const cv::Mat& mask, cv::Size size, double reach_px) {
  cv::Mat usable = mask.empty() ? cv::Mat(size, CV_8UC1, cv::Scalar(255)) : mask.clone();
  if (cv::countNonZero(usable) == static_cast<int>(usable.total())) return usable;
  const int side = 2 * static_cast<int>(std::ceil(reach_px)) + 1;
  cv::erode(usable, usable, cv::getStructuringElement(cv::MORPH_RECT, cv::Size(side, side)), cv::Point(-1, -1), 1,
            cv::BORDER_CONSTANT, cv::Scalar(255));
  return usable;
}

// 1 / (local strength + floor): levels the contrast over the picture.
cv::Mat levelling(const cv::Mat& strength, const cv::Mat& mask, const ChannelOptions& options) {
  const double mean = cv::mean(strength, mask)[0];
  cv::Mat local;
  cv::GaussianBlur(strength, local, cv::Size(), options.pool_px, options.pool_px, cv::BORDER_REFLECT_101);
  cv::Mat factor;
  cv::divide(1.0, local + cv::Scalar(options.floor_fraction * mean + 1e-3), factor);
  return factor;
}

cv::Mat double_angle_pair(const Gradient& g, const cv::Mat& factor) {
  cv::Mat pair(g.x.size(), CV_32FC2);
  for (int r = 0; r < pair.rows; ++r) {
    const auto *gx = g.x.ptr<float>(r), *gy = g.y.ptr<float>(r), *f = factor.ptr<float>(r);
    auto* out = pair.ptr<cv::Vec2f>(r);
    for (int c = 0; c < pair.cols; ++c) {
      const float x2 = gx[c] * gx[c], y2 = gy[c] * gy[c];
      const float strength = std::sqrt(x2 + y2) + 1e-6F;  // (x² − y², 2xy) / |g| is |g| at twice the angle
      out[c] = {(x2 - y2) / strength * f[c], 2 * gx[c] * gy[c] / strength * f[c]};
    }
  }
  return pair;
}

// Strength times the squared half-wave rectified cosine of twice the angle to each orientation: wide, overlapping bins.
std::vector<cv::Mat> orientation_pairs(const Gradient& g, const cv::Mat& factor) {
  std::vector<cv::Mat> pairs;
  std::array<float, kOrientations> cosine{}, sine{};
  for (int k = 0; k < kOrientations; ++k) {
    const double twice = 2.0 * std::numbers::pi * k / kOrientations;
    cosine[static_cast<std::size_t>(k)] = static_cast<float>(std::cos(twice));
    sine[static_cast<std::size_t>(k)] = static_cast<float>(std::sin(twice));
  }
  for (std::size_t p = 0; p < kOrientations / 2; ++p) {
    const std::size_t first = p, second = p + kOrientations / 2;  // perpendicular ones share a pair
    cv::Mat pair(g.x.size(), CV_32FC2);
    for (int r = 0; r < pair.rows; ++r) {
      const auto *gx = g.x.ptr<float>(r), *gy = g.y.ptr<float>(r), *f = factor.ptr<float>(r);
      auto* out = pair.ptr<cv::Vec2f>(r);
      for (int c = 0; c < pair.cols; ++c) {
        const float x2 = gx[c] * gx[c], y2 = gy[c] * gy[c];
        const float squared = x2 + y2 + 1e-12F;
        const float strength = std::sqrt(squared) * f[c];
        const float c2 = (x2 - y2) / squared, s2 = 2 * gx[c] * gy[c] / squared;
        const float a = std::max(0.0F, c2 * cosine[first] + s2 * sine[first]);
        const float b = std::max(0.0F, c2 * cosine[second] + s2 * sine[second]);
        out[c] = {strength * a * a, strength * b * b};
      }
    }
    pairs.push_back(pair);
  }
  return pairs;
}

}  // namespace

Channels oriented_channels(const cv::Mat& grey, const cv::Mat& mask, ChannelSet set, const ChannelOptions& options) {
  Channels channels;
  channels.mask = usable_part(mask, grey.size(), 2 * options.sigma_px + 1);
  const Gradient gradient = gradient_of(grey, options.sigma_px);
  cv::Mat strength;
  cv::magnitude(gradient.x, gradient.y, strength);
  strength.setTo(0, channels.mask == 0);
  const cv::Mat factor = levelling(strength, channels.mask, options);
  if (set == ChannelSet::double_angle) {
    channels.pairs.push_back(double_angle_pair(gradient, factor));
  } else {
    channels.pairs = orientation_pairs(gradient, factor);
  }
  for (cv::Mat& pair : channels.pairs) {
    pair.setTo(cv::Scalar::all(0), channels.mask == 0);  // else the border of the valid area is smoothed inwards
    cv::GaussianBlur(pair, pair, cv::Size(), options.sigma_px, options.sigma_px, cv::BORDER_REFLECT_101);
    pair.setTo(cv::Scalar::all(0), channels.mask == 0);
  }
  return channels;
}

}  // namespace nadir
