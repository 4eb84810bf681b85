#include "vision/correlation.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "base/platform.hpp"
#include "vision/integer_products.hpp"

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

constexpr double kQuantizedSteps = 256;
constexpr int kMaxRows = 8000;  // squares up to 511² of so many fit into 32 bits

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

// Sums of a run of pixels: of each channel, and of the squares of all.
template <std::size_t kChannels>
void sum_of_run(const std::int16_t* value, std::size_t columns, double* sums, std::int64_t& squares) {
  std::array<std::int64_t, kChannels> sum{};
  for (std::size_t c = 0; c < columns; ++c, value += kChannels) {
    for (std::size_t k = 0; k < kChannels; ++k) {
      sum[k] += value[k];
      squares += value[k] * value[k];
    }
  }
  for (std::size_t k = 0; k < kChannels; ++k) sums[k] += static_cast<double>(sum[k]);
}

NADIR_FOR_WIDE_REGISTERS void add_values(const std::int16_t* values, std::size_t count, std::int32_t* sums,
                                         std::int32_t* squares) {
  for (std::size_t i = 0; i < count; ++i) {
    sums[i] += values[i];
    squares[i] += values[i] * values[i];
  }
}

NADIR_FOR_WIDE_REGISTERS void exchange_values(const std::int16_t* more, const std::int16_t* less, std::size_t count,
                                              std::int32_t* sums, std::int32_t* squares) {
  for (std::size_t i = 0; i < count; ++i) {
    sums[i] += more[i] - less[i];
    squares[i] += more[i] * more[i] - less[i] * less[i];
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

LocalTemplate::LocalTemplate(const QuantizedChannels& of, const cv::Rect& part)
    : part_(part), channels_(of.channels()), means_removed_(of.means_removed()), sums_(of.channels()) {
  CV_Assert((part & cv::Rect(cv::Point(), of.size())) == part && part.height <= kMaxRows);
  for (int row = 0; row < part.height; ++row) {
    const auto* valid = of.mask().ptr<std::uint8_t>(part.y + row) + part.x;
    for (int begin = 0; begin < part.width;) {
      if (valid[begin] == 0) {
        ++begin;
        continue;
      }
      int end = begin + 1;
      while (end < part.width && valid[end] != 0) ++end;
      add_run(row, begin, end, of.at(part.y + row, part.x + begin));
      begin = end;
    }
  }
  if (!means_removed_) std::fill(sums_.begin(), sums_.end(), 0.0);
  for (const double sum : sums_) energy_ -= sum * sum / std::max(1.0, pixels_);
}

void LocalTemplate::add_run(int row, int begin, int end, const std::int16_t* values) {
  const std::size_t length = static_cast<std::size_t>(end - begin) * channels_;
  const std::size_t blocks = (length + kProductBlock - 1) / kProductBlock;
  runs_.push_back({row, begin, end, values_.size(), blocks});
  values_.insert(values_.end(), values, values + length);
  values_.resize(runs_.back().at + blocks * kProductBlock);
  std::int64_t squares = 0;
  const auto sum_up = channels_ == 6 ? sum_of_run<6> : sum_of_run<2>;
  sum_up(values, static_cast<std::size_t>(end - begin), sums_.data(), squares);
  energy_ += static_cast<double>(squares);
  pixels_ += end - begin;
}

// Of the window under the valid pixels of the template, for a row of placements: sums of each channel, of the squares
// of all, and the number of valid pixels.
struct LocalTemplate::WindowSums {
  WindowSums(std::size_t count, std::size_t channels) : sums(count * channels), valid(count), squares(count) {}

  std::vector<std::int32_t> sums, valid;
  std::vector<std::int64_t> squares;
};

// For templates without gaps over ground without gaps: columns of pixels are summed once for all placements above each
// other.
class LocalTemplate::Columns {
 public:
  Columns(const QuantizedChannels& window, const cv::Rect& part, cv::Point first, std::size_t count)
      : window_(window), part_(part), first_(first), count_(count), channels_(window.channels()) {
    columns_ = static_cast<std::size_t>(part.width) + count - 1;
    sums_.resize(columns_ * channels_);
    squares_.resize(columns_ * channels_);
    for (int row = 0; row < part.height; ++row) add_values(row_at(row), sums_.size(), sums_.data(), squares_.data());
  }

  void fill(int v, WindowSums& window) {
    if (v > 0) {
      exchange_values(row_at(v + part_.height - 1), row_at(v - 1), sums_.size(), sums_.data(), squares_.data());
    }
    const auto width = static_cast<std::size_t>(part_.width);
    std::array<std::int32_t, 6> sum{};
    std::int64_t square = 0;
    for (std::size_t c = 0; c < columns_; ++c) {
      for (std::size_t k = 0; k < channels_; ++k) {
        const std::size_t here = c * channels_ + k;
        sum[k] += sums_[here];
        square += squares_[here];
        if (c >= width) {
          sum[k] -= sums_[here - width * channels_];
          square -= squares_[here - width * channels_];
        }
      }
      if (c + 1 < width) continue;
      const std::size_t i = c + 1 - width;
      std::copy_n(sum.begin(), channels_, window.sums.begin() + static_cast<std::ptrdiff_t>(i * channels_));
      window.squares[i] = square;
      window.valid[i] = part_.area();
    }
  }

 private:
  const std::int16_t* row_at(int row) const { return window_.at(first_.y + row, first_.x); }

  const QuantizedChannels& window_;
  cv::Rect part_;
  cv::Point first_;
  std::size_t count_, channels_, columns_ = 0;
  std::vector<std::int32_t> sums_, squares_;  // of each column and channel
};

// For all others: sums along each row of the window, whose differences are those under a run.
class LocalTemplate::Rows {
 public:
  Rows(const QuantizedChannels& window, const cv::Rect& used)
      : used_(used), channels_(window.channels()), line_(static_cast<std::size_t>(used.width) + 1) {
    const auto rows = static_cast<std::size_t>(used.height);
    sums_ = std::make_unique_for_overwrite<std::int32_t[]>(rows * line_ * channels_);
    squares_ = std::make_unique_for_overwrite<std::int64_t[]>(rows * line_);
    valid_ = std::make_unique_for_overwrite<std::int32_t[]>(rows * line_);
    const auto sum_up = channels_ == 6 ? add_up<6> : add_up<2>;
    for (std::size_t r = 0; r < rows; ++r) {
      const std::size_t begin = r * line_;
      sum_up(window.at(used.y + static_cast<int>(r), used.x), line_ - 1, sums_.get() + begin * channels_,
             squares_.get() + begin);
      const auto* valid = window.mask().ptr<std::uint8_t>(used.y + static_cast<int>(r)) + used.x;
      valid_[begin] = 0;
      for (std::size_t c = 0; c + 1 < line_; ++c) valid_[begin + c + 1] = valid_[begin + c] + (valid[c] != 0 ? 1 : 0);
    }
  }

  // down: of the row of placements in pixels.
  void fill(const std::vector<Run>& runs, int down, std::size_t step, WindowSums& window) const {
    const std::size_t count = window.squares.size();
    std::fill(window.sums.begin(), window.sums.end(), 0);
    std::fill(window.squares.begin(), window.squares.end(), 0);
    std::fill(window.valid.begin(), window.valid.end(), 0);
    for (const Run& run : runs) {
      const std::size_t line = static_cast<std::size_t>(down + run.row) * line_;
      const std::size_t begin = line + static_cast<std::size_t>(run.begin),
                        end = line + static_cast<std::size_t>(run.end);
      add_differences(sums_.get() + end * channels_, sums_.get() + begin * channels_, channels_, step, count,
                      window.sums.data());
      add_differences(squares_.get() + end, squares_.get() + begin, 1, step, count, window.squares.data());
      add_differences(valid_.get() + end, valid_.get() + begin, 1, step, count, window.valid.data());
    }
  }

 private:
  cv::Rect used_;
  std::size_t channels_, line_;
  // Not vectors, because those would be filled with zeros first.
  std::unique_ptr<std::int32_t[]> sums_;     // of each channel from the row's start up to the pixel; one more per row
  std::unique_ptr<std::int64_t[]> squares_;  // of all channels, likewise
  std::unique_ptr<std::int32_t[]> valid_;    // pixels, likewise
};

cv::Mat LocalTemplate::scores(const QuantizedChannels& window, cv::Point first, cv::Size placements, double min_valid,
                              int step) const {
  const cv::Rect used(first.x, first.y, part_.width + (placements.width - 1) * step,
                      part_.height + (placements.height - 1) * step);
  CV_Assert((used & cv::Rect(cv::Point(), window.size())) == used);
  CV_Assert(window.channels() == channels_);
  const auto apart = static_cast<std::size_t>(step);
  const auto count = static_cast<std::size_t>(placements.width);
  cv::Mat result(placements, CV_32FC1, cv::Scalar(-1));
  std::vector<std::int64_t> products(count);
  std::vector<ProductRow> rows(runs_.size());
  WindowSums there(count, channels_);
  const bool no_gaps = step == 1 && runs_.size() == static_cast<std::size_t>(part_.height) && pixels_ == part_.area() &&
                       (window.whole() || cv::countNonZero(window.mask()(used)) == used.area());
  std::optional<Columns> by_columns;
  std::optional<Rows> by_rows;
  if (no_gaps) {
    by_columns.emplace(window, part_, first, count);
  } else {
    by_rows.emplace(window, used);
  }
  for (int v = 0; v < placements.height; ++v) {
    for (std::size_t i = 0; i < runs_.size(); ++i) {
      const Run& run = runs_[i];
      rows[i] = {values_.data() + run.at, window.at(first.y + v * step + run.row, first.x + run.begin), run.blocks};
    }
    sum_products(rows, apart * channels_, count, products.data());
    if (by_columns) {
      by_columns->fill(v, there);
    } else {
      by_rows->fill(runs_, v * step, apart, there);
    }
    auto* out = result.ptr<float>(v);
    for (std::size_t i = 0; i < count; ++i) {
      const double overlap = there.valid[i];
      if (overlap < min_valid * pixels_ || overlap == 0) continue;
      double product = static_cast<double>(products[i]), energy = static_cast<double>(there.squares[i]);
      for (std::size_t k = 0; k < channels_; ++k) {
        const double sum = there.sums[i * channels_ + k];
        product -= sums_[k] * sum / pixels_;
        if (means_removed_) energy -= sum * sum / overlap;
      }
      // As in TemplateNorm: ground without texture matches nothing, and a placement half off the map is not favoured.
      constexpr double kMinQuantizedVariance = kMinVariance * kQuantizedSteps * kQuantizedSteps;
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
  channels_.emplace(quantized_channels(image, mask, set_, options_));
  half_.reset();
}

const QuantizedChannels& MapChannels::half() {
  if (!half_) half_.emplace(channels_->halved({0, 0}));
  return *half_;
}

}  // namespace nadir
