#include "vision/feature_matching.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>

#include "base/platform.hpp"

namespace nadir {
namespace {

struct Nearest {
  std::int32_t best = std::numeric_limits<std::int32_t>::max();
  std::int32_t second = std::numeric_limits<std::int32_t>::max();
  std::size_t at = 0;
};

// |a - b|^2 = |a|^2 + |b|^2 - 2 ab; at most 128 * 255^2.
NADIR_FOR_WIDE_REGISTERS Nearest nearest_of(const std::int16_t* wanted, std::int32_t square,
                                            const FeatureDescriptors& among) {
  Nearest nearest;
  for (std::size_t j = 0; j < among.size(); ++j) {
    const std::int16_t* other = among.at(j);
    std::int32_t product = 0;
    for (std::size_t k = 0; k < FeatureDescriptors::kLength; ++k) product += wanted[k] * other[k];
    const std::int32_t distance = square + among.square(j) - 2 * product;
    if (distance < nearest.best) {
      nearest.second = nearest.best;
      nearest.best = distance;
      nearest.at = j;
    } else if (distance < nearest.second) {
      nearest.second = distance;
    }
  }
  return nearest;
}

}  // namespace

FeatureDescriptors::FeatureDescriptors(const cv::Mat& rows) {
  if (rows.empty()) return;
  CV_Assert(rows.type() == CV_32FC1 && rows.cols == static_cast<int>(kLength));
  std::array<std::int16_t, kLength> descriptor;
  for (int r = 0; r < rows.rows; ++r) {
    std::transform(rows.ptr<float>(r), rows.ptr<float>(r) + kLength, descriptor.begin(),
                   [](float value) { return static_cast<std::int16_t>(std::lround(value)); });
    add(descriptor);
  }
}

void FeatureDescriptors::add(std::span<const std::int16_t, kLength> descriptor) {
  values_.insert(values_.end(), descriptor.begin(), descriptor.end());
  std::int32_t square = 0;
  for (const std::int16_t value : descriptor) square += value * value;
  squares_.push_back(square);
}

std::vector<FeatureMatch> unambiguous_matches(const FeatureDescriptors& first, const FeatureDescriptors& second,
                                              double ratio) {
  std::vector<FeatureMatch> matches;
  if (second.size() < 2) return matches;
  for (std::size_t i = 0; i < first.size(); ++i) {
    const Nearest nearest = nearest_of(first.at(i), first.square(i), second);
    if (nearest.best < ratio * ratio * nearest.second) matches.push_back({i, nearest.at});
  }
  return matches;
}

}  // namespace nadir
