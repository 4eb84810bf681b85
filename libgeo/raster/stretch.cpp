#include "raster/stretch.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <vector>

#include "base/error.hpp"
#include "base/number_text.hpp"
#include "raster/gdal_dataset.hpp"

namespace nadir {
StretchRequest parse_stretch(std::string_view text) {
  if (text == "none") return {};
  constexpr std::string_view kPercentile = "percentile:";
  StretchRequest request{.kind = StretchRequest::Kind::values};
  std::string_view numbers = text;
  if (numbers.starts_with(kPercentile)) {
    request.kind = StretchRequest::Kind::percentile;
    numbers.remove_prefix(kPercentile.size());
  }
  const std::size_t comma = numbers.find(',');
  if (comma != std::string_view::npos) {
    const auto low = finite_number(numbers.substr(0, comma)), high = finite_number(numbers.substr(comma + 1));
    if (low && high && *low < *high) {
      request.low = *low, request.high = *high;
      if (request.kind == StretchRequest::Kind::values || (request.low >= 0 && request.high <= 100)) return request;
    }
  }
  throw UsageError({.what = "the stretch cannot be parsed",
                    .where = "--stretch",
                    .expected = "MIN,MAX with MIN below MAX; percentile:LOW,HIGH between 0 and 100; or none",
                    .found = std::string(text),
                    .fix = "for example --stretch 0,4000 or --stretch percentile:2,98"});
}

std::string to_text(const Stretch& stretch) { return fmt::format("{} to {}", stretch.low, stretch.high); }

namespace {

constexpr std::int64_t kMaxWholeRaster_px = 1 << 20;  // a raster up to this size is sampled completely
constexpr int kWindowsPerSide = 16;                   // along each side of a larger one
constexpr int kWindow_px = 64;

void append_valid(const RasterSamples& samples, std::vector<float>& values) {
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
  if (std::int64_t{size.width} * size.height <= kMaxWholeRaster_px) {
    append_valid(dataset.read_samples(whole, size), values);
  } else {
    for (int row = 0; row < kWindowsPerSide; ++row) {
      for (int column = 0; column < kWindowsPerSide; ++column) {
        const auto middle = [](int i, int side) {
          return static_cast<int>(std::int64_t{side} * (2 * i + 1) / (2 * kWindowsPerSide));
        };
        const cv::Rect window = cv::Rect(middle(column, size.width) - kWindow_px / 2,
                                         middle(row, size.height) - kWindow_px / 2, kWindow_px, kWindow_px) &
                                whole;
        if (!window.empty()) append_valid(dataset.read_samples(window, window.size()), values);
      }
    }
  }
  std::sort(values.begin(), values.end());
  return values;
}

double percentile(const std::vector<float>& sorted, double percent) {
  const double rank = percent / 100 * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<std::size_t>(rank);
  const std::size_t above = std::min(below + 1, sorted.size() - 1);
  const double fraction = rank - static_cast<double>(below);
  return static_cast<double>(sorted[below]) * (1 - fraction) + static_cast<double>(sorted[above]) * fraction;
}

[[noreturn]] void reject(const GdalDataset& dataset, std::string what, std::string expected, std::string found,
                         std::string fix) {
  throw UsageError({.what = std::move(what),
                    .where = dataset.path().string(),
                    .expected = std::move(expected),
                    .found = std::move(found),
                    .fix = std::move(fix)});
}

}  // namespace

std::optional<Stretch> resolve_stretch(const std::filesystem::path& raster, const StretchRequest& request) {
  const GdalDataset dataset(raster);
  if (dataset.layout().eight_bit) return std::nullopt;
  if (request.kind == StretchRequest::Kind::values) return Stretch{request.low, request.high};
  const std::vector<float> values = sample(dataset);
  if (values.empty()) {
    reject(dataset, "the raster has no valid pixel in the sampled windows", "pixels that are not nodata", "none",
           "state the values: --stretch MIN,MAX");
  }
  if (request.kind == StretchRequest::Kind::none) {
    reject(dataset, "the raster is not 8 bit", "a stretch to 8 bit",
           fmt::format("{}, values {} to {}", dataset.layout().type, values.front(), values.back()),
           fmt::format("state it: --stretch {},{}, or --stretch percentile:2,98", values.front(), values.back()));
  }
  const Stretch stretch{percentile(values, request.low), percentile(values, request.high)};
  if (stretch.low < stretch.high) return stretch;
  reject(dataset, "the raster's percentiles are equal",
         fmt::format("different values at percentiles {} and {}", request.low, request.high),
         fmt::format("{} at both", stretch.low), "state the values: --stretch MIN,MAX");
}

}  // namespace nadir
