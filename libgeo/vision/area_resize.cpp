#include "vision/area_resize.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "base/platform.hpp"

namespace nadir {
namespace {

constexpr double kLeastShare = 1e-3;  // of a source pixel: less is left out, as OpenCV does

// Of one axis: what contributes to target t is sources[begin[t]] to sources[begin[t + 1] - 1].
struct Contributions {
  struct One {
    int source;
    float weight;
  };
  std::vector<One> sources;
  std::vector<std::size_t> begin{0};
};

Contributions contributions(int source_size, int target_size) {
  const double scale = 1 / (static_cast<double>(target_size) / source_size);
  Contributions all;
  for (int target = 0; target < target_size; ++target) {
    const double begin = target * scale, end = begin + scale;
    const double length = std::min(scale, source_size - begin);
    const int last_whole = std::min(static_cast<int>(std::floor(end)), source_size - 1);
    const int first_whole = std::min(static_cast<int>(std::ceil(begin)), last_whole);
    const auto add = [&](int source, double share) {
      all.sources.push_back({source, static_cast<float>(share / length)});
    };
    if (first_whole - begin > kLeastShare) add(first_whole - 1, first_whole - begin);
    for (int source = first_whole; source < last_whole; ++source) add(source, 1);
    if (end - last_whole > kLeastShare) add(last_whole, std::min({end - last_whole, 1.0, length}));
    all.begin.push_back(all.sources.size());
  }
  return all;
}

// sums += weight · row
NADIR_FOR_WIDE_REGISTERS void add_row(const std::uint8_t* row, float weight, std::size_t count,
                                      float* __restrict sums) {
  for (std::size_t i = 0; i < count; ++i) sums[i] += weight * static_cast<float>(row[i]);
}

void reduce_row(const float* sums, std::size_t channels, const Contributions& across, std::uint8_t* result) {
  for (std::size_t target = 0; target + 1 < across.begin.size(); ++target) {
    for (std::size_t k = 0; k < channels; ++k) {
      float value = 0;
      for (std::size_t i = across.begin[target]; i < across.begin[target + 1]; ++i) {
        value += sums[static_cast<std::size_t>(across.sources[i].source) * channels + k] * across.sources[i].weight;
      }
      *result++ = cv::saturate_cast<std::uint8_t>(value);
    }
  }
}

}  // namespace

cv::Mat area_resized(const cv::Mat& image, cv::Size size) {
  CV_Assert(image.depth() == CV_8U);
  cv::Mat result;
  const bool whole = image.cols % size.width == 0 && image.rows % size.height == 0;
  if (whole || size.width > image.cols || size.height > image.rows) {
    cv::resize(image, result, size, 0, 0, cv::INTER_AREA);
    return result;
  }
  const Contributions across = contributions(image.cols, size.width), down = contributions(image.rows, size.height);
  result.create(size, image.type());
  // Rows first, all columns side by side: that is most of the work, and for wide registers.
  const auto channels = static_cast<std::size_t>(image.channels());
  std::vector<float> sums(static_cast<std::size_t>(image.cols) * channels);
  for (int row = 0; row < size.height; ++row) {
    std::fill(sums.begin(), sums.end(), 0.0F);
    const auto target = static_cast<std::size_t>(row);
    for (std::size_t i = down.begin[target]; i < down.begin[target + 1]; ++i) {
      add_row(image.ptr<std::uint8_t>(down.sources[i].source), down.sources[i].weight, sums.size(), sums.data());
    }
    reduce_row(sums.data(), channels, across, result.ptr<std::uint8_t>(row));
  }
  return result;
}

}  // namespace nadir
