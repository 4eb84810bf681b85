#include "vision/area_resize.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

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

// sum += weight · (the row of pixels, reduced)
void add_row(const std::uint8_t* pixels, int channels, const Contributions& across, float weight,
             std::vector<float>& sum) {
  std::size_t out = 0;
  for (std::size_t target = 0; target + 1 < across.begin.size(); ++target) {
    for (int k = 0; k < channels; ++k, ++out) {
      float value = 0;
      for (std::size_t i = across.begin[target]; i < across.begin[target + 1]; ++i) {
        value += static_cast<float>(pixels[across.sources[i].source * channels + k]) * across.sources[i].weight;
      }
      sum[out] += weight * value;
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
  std::vector<float> sum(static_cast<std::size_t>(size.width * image.channels()));
  for (int row = 0; row < size.height; ++row) {
    std::fill(sum.begin(), sum.end(), 0.0F);
    const auto target = static_cast<std::size_t>(row);
    for (std::size_t i = down.begin[target]; i < down.begin[target + 1]; ++i) {
      add_row(image.ptr<std::uint8_t>(down.sources[i].source), image.channels(), across, down.sources[i].weight, sum);
    }
    std::transform(sum.begin(), sum.end(), result.ptr<std::uint8_t>(row),
                   [](float value) { return cv::saturate_cast<std::uint8_t>(value); });
  }
  return result;
}

}  // namespace nadir
