#include "vision/correlation.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "base/platform.hpp"

namespace nadir {
namespace {

cv::Mat spectrum_of(const cv::Mat& complex, cv::Size fft_size) {
  cv::Mat padded = cv::Mat::zeros(fft_size, CV_32FC2);
  complex.copyTo(padded(cv::Rect(0, 0, complex.cols, complex.rows)));
  cv::dft(padded, padded, 0, complex.rows);
  return padded;
}

// The correlation with a template's spectrum, cut to the placements that lie inside the window.
cv::Mat inverse(cv::Mat product, cv::Size placements) {
  cv::dft(product, product, cv::DFT_INVERSE | cv::DFT_SCALE);
  return product(cv::Rect(cv::Point(0, 0), placements));
}

cv::Mat product_with_conjugate(const cv::Mat& window, const cv::Mat& pattern) {
  cv::Mat product;
  cv::mulSpectrums(window, pattern, product, 0, true);
  return product;
}

cv::Mat real_complex(const cv::Mat& real) {
  cv::Mat complex;
  cv::merge(std::vector<cv::Mat>{real, cv::Mat::zeros(real.size(), CV_32FC1)}, complex);
  return complex;
}

cv::Mat unit_mask(const cv::Mat& mask) {
  cv::Mat unit;
  mask.convertTo(unit, CV_32F, 1.0 / 255.0);
  return unit;
}

cv::Size placements_of(cv::Size window, cv::Size pattern) {
  return {window.width - pattern.width + 1, window.height - pattern.height + 1};
}

// Subtracts the mean under the mask and clears the rest.
cv::Mat centred(const cv::Mat& pair, const cv::Mat& mask, bool means_removed) {
  cv::Mat result = pair - (means_removed ? cv::mean(pair, mask) : cv::Scalar());
  result.setTo(cv::Scalar::all(0), mask == 0);
  return result;
}

float parabola_offset(float before, float here, float after, double& curvature) {
  const float bend = before - 2 * here + after;
  curvature = -static_cast<double>(bend);
  if (bend >= -kMinPeakCurvature) return 0;
  return std::clamp(0.5F * (before - after) / bend, -0.5F, 0.5F);
}

Peak refined_peak(const cv::Mat& scores, cv::Point at) {
  Peak peak;
  peak.score = static_cast<double>(scores.at<float>(at));
  peak.x = at.x;
  peak.y = at.y;
  const float here = scores.at<float>(at);
  if (at.x > 0 && at.x + 1 < scores.cols) {
    peak.x += static_cast<double>(
        parabola_offset(scores.at<float>(at.y, at.x - 1), here, scores.at<float>(at.y, at.x + 1), peak.curvature_x));
  }
  if (at.y > 0 && at.y + 1 < scores.rows) {
    peak.y += static_cast<double>(
        parabola_offset(scores.at<float>(at.y - 1, at.x), here, scores.at<float>(at.y + 1, at.x), peak.curvature_y));
  }
  return peak;
}

constexpr float kScale = 256;
constexpr std::int32_t kMaxQuantized = 511;
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

// A row of a pair of channels in integer steps, less the mean at each position.
void quantize(const float* values, const float* mean, std::size_t count, std::int16_t* whole) {
  for (std::size_t i = 0; i < count; ++i) {
    const float scaled = values[i] * kScale - mean[i];
    const auto rounded = static_cast<std::int32_t>(scaled + std::copysign(0.5F, scaled));
    whole[i] = static_cast<std::int16_t>(std::min(std::max(rounded, -kMaxQuantized), kMaxQuantized));
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

WindowSpectra::WindowSpectra(const Channels& window)
    : window_size_(window.mask.size()),
      fft_size_(cv::getOptimalDFTSize(window.mask.cols), cv::getOptimalDFTSize(window.mask.rows)),
      means_removed_(window.means_removed) {
  cv::Mat energy = cv::Mat::zeros(window_size_, CV_32FC1);
  for (const cv::Mat& pair : window.pairs) {
    const cv::Mat centred_pair = centred(pair, window.mask, means_removed_);
    cv::Mat parts[2];
    cv::split(centred_pair, parts);
    energy += parts[0].mul(parts[0]) + parts[1].mul(parts[1]);
    pairs_.push_back(spectrum_of(centred_pair, fft_size_));
  }
  cv::Mat both;
  cv::merge(std::vector<cv::Mat>{energy, unit_mask(window.mask)}, both);
  energy_and_valid_ = spectrum_of(both, fft_size_);
}

TemplateNorm::TemplateNorm(const Channels& shape, const WindowSpectra& window, double min_valid)
    : template_size_(shape.mask.size()) {
  const cv::Size placements = placements_of(window.window_size_, template_size_);
  CV_Assert(placements.width > 0 && placements.height > 0);
  const cv::Mat mask = spectrum_of(real_complex(unit_mask(shape.mask)), window.fft_size_);
  const cv::Mat sums = inverse(product_with_conjugate(window.energy_and_valid_, mask), placements);
  cv::Mat means_squared = cv::Mat::zeros(placements, CV_32FC1);
  for (const cv::Mat& pair : window.pairs_) {
    if (!window.means_removed_) break;
    const cv::Mat sum = inverse(product_with_conjugate(pair, mask), placements);
    for (int r = 0; r < placements.height; ++r) {
      const auto* from = sum.ptr<cv::Vec2f>(r);
      auto* to = means_squared.ptr<float>(r);
      for (int c = 0; c < placements.width; ++c) to[c] += from[c][0] * from[c][0] + from[c][1] * from[c][1];
    }
  }
  const auto area = static_cast<float>(std::max(1, cv::countNonZero(shape.mask)));
  const auto needed = static_cast<float>(min_valid) * area;
  inverse_norm_.create(placements, CV_32FC1);
  for (int r = 0; r < placements.height; ++r) {
    const auto* energy_valid = sums.ptr<cv::Vec2f>(r);
    const auto* squared = means_squared.ptr<float>(r);
    auto* out = inverse_norm_.ptr<float>(r);
    for (int c = 0; c < placements.width; ++c) {
      const float valid = energy_valid[c][1];
      const float variance = energy_valid[c][0] - squared[c] / std::max(valid, 1.0F);
      // A placement half off the map has little energy: scale it to the whole area, so that it is not favoured.
      out[c] = valid < needed || variance < static_cast<float>(kMinVariance) * area
                   ? 0.0F
                   : std::sqrt(valid / area) / std::sqrt(variance);
    }
  }
}

cv::Mat correlate(const Channels& pattern, const WindowSpectra& window, const TemplateNorm& norm) {
  CV_Assert(pattern.mask.size() == norm.template_size_ && pattern.pairs.size() == window.pairs_.size());
  const cv::Size placements = placements_of(window.window_size_, pattern.mask.size());
  cv::Mat sum = cv::Mat::zeros(window.fft_size_, CV_32FC2);
  double energy = 0;
  for (std::size_t i = 0; i < pattern.pairs.size(); ++i) {
    const cv::Mat centred_pair = centred(pattern.pairs[i], pattern.mask, window.means_removed_);
    energy += centred_pair.dot(centred_pair);
    sum += product_with_conjugate(window.pairs_[i], spectrum_of(centred_pair, window.fft_size_));
  }
  const cv::Mat product = inverse(sum, placements);
  const auto inverse_template_norm = static_cast<float>(energy > kMinTemplateEnergy ? 1.0 / std::sqrt(energy) : 0.0);
  cv::Mat scores(placements, CV_32FC1);
  for (int r = 0; r < placements.height; ++r) {
    const auto* from = product.ptr<cv::Vec2f>(r);
    const auto* factor = norm.inverse_norm_.ptr<float>(r);
    auto* to = scores.ptr<float>(r);
    for (int c = 0; c < placements.width; ++c) {
      to[c] = factor[c] > 0 ? from[c][0] * factor[c] * inverse_template_norm : -1.0F;
    }
  }
  return scores;
}

Peak best_peak(const cv::Mat& scores) {
  cv::Point at;
  cv::minMaxLoc(scores, nullptr, nullptr, nullptr, &at);
  return refined_peak(scores, at);
}

std::vector<Peak> distinct_peaks(const cv::Mat& scores, std::size_t count, double min_distance_px) {
  std::vector<Peak> peaks;
  cv::Mat left = scores.clone();
  while (peaks.size() < count) {
    double score = 0;
    cv::Point at;
    cv::minMaxLoc(left, nullptr, &score, nullptr, &at);
    if (score <= 0) break;
    peaks.push_back(refined_peak(scores, at));
    cv::circle(left, at, static_cast<int>(std::ceil(min_distance_px)), cv::Scalar(-1), cv::FILLED);
  }
  return peaks;
}

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
      quantize(channels.pairs[p].ptr<float>(static_cast<int>(r)), mean.data() + 2 * columns * p, 2 * columns,
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

LocalTemplate::LocalTemplate(const QuantizedChannels& of, const cv::Rect& part)
    : of_(&of), part_(part), sums_(of.channels_) {
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
      const double overlap = valid[i];
      if (overlap < min_valid * pixels_ || overlap == 0) continue;
      double product = static_cast<double>(products[i]), energy = static_cast<double>(squares[i]);
      for (std::size_t k = 0; k < channels; ++k) {
        const double sum = sums[i * channels + k];
        product -= sums_[k] * sum / pixels_;
        if (of_->means_removed_) energy -= sum * sum / overlap;
      }
      // As in TemplateNorm: ground without texture matches nothing, and a placement half off the map is not favoured.
      constexpr double kMinQuantizedVariance = kMinVariance * double{kScale} * double{kScale};
      if (energy < kMinQuantizedVariance * pixels_) continue;
      out[i] =
          energy_ > 0 ? static_cast<float>(product / std::sqrt(energy * energy_) * std::sqrt(overlap / pixels_)) : 0.0F;
    }
  }
  return result;
}

MapChannels::MapChannels(cv::Mat image, cv::Mat mask, ChannelSet set, const ChannelOptions& options)
    : image_(std::move(image)), mask_(std::move(mask)), set_(set), options_(options) {}

void MapChannels::cover(const cv::Rect& part) {
  if (channels_ && (part & part_) == part) return;
  part_ = {part.x - kMapChannelsMargin_px, part.y - kMapChannelsMargin_px, part.width + 2 * kMapChannelsMargin_px,
           part.height + 2 * kMapChannelsMargin_px};
  const cv::Rect available = part_ & cv::Rect(cv::Point(), map_size());
  cv::Mat image(part_.size(), CV_8UC1, cv::Scalar(0)), mask(part_.size(), CV_8UC1, cv::Scalar(0));
  if (!available.empty()) {
    image_(available).copyTo(image(available - part_.tl()));
    mask_(available).copyTo(mask(available - part_.tl()));
  }
  channels_.emplace(oriented_channels(image, mask, set_, options_));
}

}  // namespace nadir
