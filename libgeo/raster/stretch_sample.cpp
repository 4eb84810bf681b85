#include "raster/stretch_sample.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "base/error.hpp"
#include "raster/gdal_dataset.hpp"

namespace nadir {
namespace {

constexpr std::int64_t kAllOf_px = 1 << 20;  // a raster up to this size is looked at wholly
constexpr int kWindows = 16;                 // along each side of a larger one
constexpr int kWindow_px = 64;

void add(const Samples& samples, std::vector<float>& values) {
  const int channels = samples.values.channels();
  for (int row = 0; row < samples.values.rows; ++row) {
    const auto* value = samples.values.ptr<float>(row);
    const auto* valid = samples.mask.ptr<std::uint8_t>(row);
    for (int i = 0; i < samples.values.cols * channels; ++i) {
      if (valid[i / channels] != 0) values.push_back(value[i]);
    }
  }
}

// In ascending order.
std::vector<float> sample(const GdalDataset& dataset) {
  const cv::Size size = dataset.size();
  const cv::Rect whole({0, 0}, size);
  std::vector<float> values;
  if (std::int64_t{size.width} * size.height <= kAllOf_px) {
    add(dataset.read_samples(whole, size), values);
  } else {
    for (int row = 0; row < kWindows; ++row) {
      for (int column = 0; column < kWindows; ++column) {
        const auto middle = [](int i, int side) {
          return static_cast<int>(std::int64_t{side} * (2 * i + 1) / (2 * kWindows));
        };
        const cv::Rect window = cv::Rect(middle(column, size.width) - kWindow_px / 2,
                                         middle(row, size.height) - kWindow_px / 2, kWindow_px, kWindow_px) &
                                whole;
        if (!window.empty()) add(dataset.read_samples(window, window.size()), values);
      }
    }
  }
  std::sort(values.begin(), values.end());
  return values;
}

double percentile(const std::vector<float>& sorted, double percent) {
  const double place = percent / 100 * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<std::size_t>(place);
  const std::size_t above = std::min(below + 1, sorted.size() - 1);
  const double share = place - static_cast<double>(below);
  return static_cast<double>(sorted[below]) * (1 - share) + static_cast<double>(sorted[above]) * share;
}

[[noreturn]] void refuse(const GdalDataset& dataset, std::string what, std::string expected, std::string found,
                         std::string fix) {
  throw UsageError({.what = std::move(what),
                    .where = dataset.path().string(),
                    .expected = std::move(expected),
                    .found = std::move(found),
                    .fix = std::move(fix)});
}

}  // namespace

std::optional<Stretch> settle_stretch(const std::filesystem::path& raster, const StretchWish& wish) {
  const GdalDataset dataset(raster);
  if (dataset.layout().eight_bit) return std::nullopt;
  if (wish.kind == StretchWish::Kind::values) return Stretch{wish.low, wish.high};
  const std::vector<float> values = sample(dataset);
  if (values.empty()) {
    refuse(dataset, "the raster has no valid pixel where its values were looked at", "pixels that are not nodata",
           "none", "state the values: --stretch MIN,MAX");
  }
  if (wish.kind == StretchWish::Kind::none) {
    refuse(dataset, "the raster is not 8 bit", "a stated stretch to 8 bit",
           fmt::format("{}, values {} to {}", dataset.layout().type, values.front(), values.back()),
           fmt::format("state it: --stretch {},{}, or --stretch percentile:2,98", values.front(), values.back()));
  }
  const Stretch stretch{percentile(values, wish.low), percentile(values, wish.high)};
  if (stretch.low < stretch.high) return stretch;
  refuse(dataset, "the raster's percentiles leave nothing to stretch",
         fmt::format("different values at percentiles {} and {}", wish.low, wish.high),
         fmt::format("{} at both", stretch.low), "state the values: --stretch MIN,MAX");
}

}  // namespace nadir
