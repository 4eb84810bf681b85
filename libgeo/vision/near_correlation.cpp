#include "vision/near_correlation.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core.hpp>

#include "base/platform.hpp"

namespace nadir {
namespace {

constexpr float kScale = 256;
constexpr std::int32_t kMost = 511;
constexpr int kMaxRun = 1300;  // pixels of six channels whose products fit into 32 bits: 6 · 1300 · 511² < 2³¹

// products[i] += Σ pattern[k] · window[i · step + k]
NADIR_FOR_WIDE_REGISTERS void add_products(const std::int16_t* pattern, const std::int16_t* window, std::size_t length,
                                           std::size_t step, std::size_t count, std::int64_t* products) {
  for (std::size_t i = 0; i < count; ++i) {
    const std::int16_t* at = window + i * step;
    std::int32_t sum = 0;
    for (std::size_t k = 0; k < length; ++k) sum += pattern[k] * at[k];
    products[i] += sum;
  }
}

// sums[i · group + k] += end[i · step · group + k] - begin[…]
template <typename Whole>
void add_differences(const Whole* end, const Whole* begin, std::size_t group, std::size_t step, std::size_t count,
                     Whole* sums) {
  if (step == 1) {
    for (std::size_t i = 0; i < count * group; ++i) sums[i] += end[i] - begin[i];
    return;
  }
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t k = 0; k < group; ++k) {
      sums[i * group + k] += end[i * step * group + k] - begin[i * step * group + k];
    }
  }
}

// A row of a pair of channels in whole steps, less the mean that stands at each place.
void whole_numbers(const float* values, const float* mean, std::size_t count, std::int16_t* whole) {
  for (std::size_t i = 0; i < count; ++i) {
    const float scaled = values[i] * kScale - mean[i];
    const auto rounded = static_cast<std::int32_t>(scaled + std::copysign(0.5F, scaled));
    whole[i] = static_cast<std::int16_t>(std::min(std::max(rounded, -kMost), kMost));
  }
}

// Running sums of a row: of each channel, and of the squares of all.
template <std::size_t kChannels>
void add_up(const std::int16_t* value, std::size_t columns, std::int32_t* sums, std::int64_t* squares) {
  std::array<std::int32_t, kChannels> sum{};
  std::int64_t square = squares[0] = 0;
  std::fill_n(sums, kChannels, 0);
  for (std::size_t c = 0; c < columns; ++c, value += kChannels) {
    std::int32_t here = 0;
    for (std::size_t k = 0; k < kChannels; ++k) {
      sum[k] += value[k];
      here += value[k] * value[k];
      sums[(c + 1) * kChannels + k] = sum[k];
    }
    squares[c + 1] = square += here;
  }
}

}  // namespace

QuantizedChannels::QuantizedChannels(const Channels& channels)
    : mask_(channels.mask), channels_(2 * channels.pairs.size()), means_removed_(channels.means_removed) {
  CV_Assert(channels_ == 2 || channels_ == 6);
  const auto rows = static_cast<std::size_t>(mask_.rows), columns = static_cast<std::size_t>(mask_.cols);
  values_ = std::make_unique_for_overwrite<std::int16_t[]>(rows * columns * channels_);
  sums_ = std::make_unique_for_overwrite<std::int32_t[]>(rows * (columns + 1) * channels_);
  squares_ = std::make_unique_for_overwrite<std::int64_t[]>(rows * (columns + 1));
  valid_ = std::make_unique_for_overwrite<std::int32_t[]>(rows * (columns + 1));
  // What is not valid counts as the mean, which is then 0.
  std::vector<float> mean(columns * channels_);
  for (std::size_t p = 0; p < channels.pairs.size(); ++p) {
    const cv::Scalar both = means_removed_ ? cv::mean(channels.pairs[p], mask_) : cv::Scalar();
    for (std::size_t i = 0; i < 2 * columns; ++i) {
      mean[2 * columns * p + i] = std::round(static_cast<float>(both[static_cast<int>(i % 2)]) * kScale);
    }
  }
  std::vector<std::int16_t> pair_values(2 * columns);
  for (std::size_t r = 0; r < rows; ++r) {
    const auto* valid = mask_.ptr<std::uint8_t>(static_cast<int>(r));
    std::int16_t* value = values_.get() + r * columns * channels_;
    for (std::size_t p = 0; p < channels.pairs.size(); ++p) {
      whole_numbers(channels.pairs[p].ptr<float>(static_cast<int>(r)), mean.data() + 2 * columns * p, 2 * columns,
                    pair_values.data());
      for (std::size_t c = 0; c < columns; ++c) {
        const bool keep = valid[c] != 0;
        value[c * channels_ + 2 * p] = keep ? pair_values[2 * c] : std::int16_t{0};
        value[c * channels_ + 2 * p + 1] = keep ? pair_values[2 * c + 1] : std::int16_t{0};
      }
    }
    const std::size_t line = r * (columns + 1);
    const auto sum_up = channels_ == 6 ? add_up<6> : add_up<2>;
    sum_up(value, columns, sums_.get() + line * channels_, squares_.get() + line);
    valid_[line] = 0;
    for (std::size_t c = 0; c < columns; ++c) valid_[line + c + 1] = valid_[line + c] + (valid[c] != 0 ? 1 : 0);
  }
}

LocalTemplate::LocalTemplate(const QuantizedChannels& of, const cv::Rect& part) : of_(&of), part_(part), sums_(of.channels_) {
  CV_Assert((part & cv::Rect(cv::Point(), of.size())) == part && part.width <= kMaxRun && of.channels_ <= 6);
  const auto columns = static_cast<std::size_t>(of.mask_.cols);
  double squares = 0;
  for (int row = 0; row < part.height; ++row) {
    const auto* valid = of.mask_.ptr<std::uint8_t>(part.y + row) + part.x;
    for (int begin = 0; begin < part.width;) {
      if (valid[begin] == 0) {
        ++begin;
        continue;
      }
      int end = begin + 1;
      while (end < part.width && valid[end] != 0) ++end;
      runs_.push_back({row, begin, end});
      const std::size_t line = static_cast<std::size_t>(part.y + row) * (columns + 1);
      const std::size_t from = line + static_cast<std::size_t>(part.x + begin);
      const std::size_t to = line + static_cast<std::size_t>(part.x + end);
      for (std::size_t k = 0; k < of.channels_; ++k) {
        sums_[k] += of.sums_[to * of.channels_ + k] - of.sums_[from * of.channels_ + k];
      }
      squares += static_cast<double>(of.squares_[to] - of.squares_[from]);
      pixels_ += end - begin;
      begin = end;
    }
  }
  energy_ = squares;
  if (!of.means_removed_) std::fill(sums_.begin(), sums_.end(), 0.0);
  for (const double sum : sums_) energy_ -= sum * sum / std::max(1.0, pixels_);
}

cv::Mat LocalTemplate::scores(const QuantizedChannels& window, cv::Point first, cv::Size placements, double min_valid,
                            int step) const {
  const cv::Rect used(first.x, first.y, part_.width + (placements.width - 1) * step,
                      part_.height + (placements.height - 1) * step);
  CV_Assert((used & cv::Rect(cv::Point(), window.size())) == used);
  const auto apart = static_cast<std::size_t>(step);
  CV_Assert(window.channels_ == of_->channels_);
  const std::size_t channels = of_->channels_, count = static_cast<std::size_t>(placements.width);
  const auto columns = static_cast<std::size_t>(window.mask_.cols);
  const auto own_columns = static_cast<std::size_t>(of_->mask_.cols);
  cv::Mat result(placements, CV_32FC1, cv::Scalar(-1));
  std::vector<std::int64_t> products(count), squares(count);
  std::vector<std::int32_t> sums(count * channels), valid(count);
  for (int v = 0; v < placements.height; ++v) {
    std::fill(products.begin(), products.end(), 0);
    std::fill(squares.begin(), squares.end(), 0);
    std::fill(sums.begin(), sums.end(), 0);
    std::fill(valid.begin(), valid.end(), 0);
    for (const Run& run : runs_) {
      const auto row = static_cast<std::size_t>(first.y + v * step + run.row);
      const auto begin = static_cast<std::size_t>(first.x + run.begin),
                 end = static_cast<std::size_t>(first.x + run.end);
      const std::size_t own =
          static_cast<std::size_t>(part_.y + run.row) * own_columns + static_cast<std::size_t>(part_.x + run.begin);
      add_products(of_->values_.get() + own * channels, window.values_.get() + (row * columns + begin) * channels,
                   (end - begin) * channels, apart * channels, count, products.data());
      const std::size_t line = row * (columns + 1);
      add_differences(window.sums_.get() + (line + end) * channels, window.sums_.get() + (line + begin) * channels,
                      channels, apart, count, sums.data());
      add_differences(window.squares_.get() + line + end, window.squares_.get() + line + begin, 1, apart, count,
                      squares.data());
      add_differences(window.valid_.get() + line + end, window.valid_.get() + line + begin, 1, apart, count,
                      valid.data());
    }
    auto* out = result.ptr<float>(v);
    for (std::size_t i = 0; i < count; ++i) {
      const double seen = valid[i];
      if (seen < min_valid * pixels_ || seen == 0) continue;
      double product = static_cast<double>(products[i]), energy = static_cast<double>(squares[i]);
      for (std::size_t k = 0; k < channels; ++k) {
        const double sum = sums[i * channels + k];
        product -= sums_[k] * sum / pixels_;
        if (of_->means_removed_) energy -= sum * sum / seen;
      }
      // As in correlation.cpp: what has no texture matches nothing, and what is half off the map is not favoured.
      constexpr double kLeastVariance = 1e-6 * double{kScale} * double{kScale};
      if (energy < kLeastVariance * pixels_) continue;
      out[i] =
          energy_ > 0 ? static_cast<float>(product / std::sqrt(energy * energy_) * std::sqrt(seen / pixels_)) : 0.0F;
    }
  }
  return result;
}

}  // namespace nadir
