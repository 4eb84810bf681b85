#include "vision/correlation.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "base/platform.hpp"
#include "vision/integer_products.hpp"

namespace nadir {
namespace {

cv::Size placements_of(cv::Size window, cv::Size pattern) {
  return {window.width - pattern.width + 1, window.height - pattern.height + 1};
}

std::size_t size_of(int count) { return static_cast<std::size_t>(count); }

// The channels of a pair less their means under the mask, 0 elsewhere, and the sum of their squares.
struct CentredPair {
  ComplexImage image;
  double energy = 0;
};

CentredPair centred(const cv::Mat& pair, const cv::Mat& mask, bool means_removed) {
  const cv::Scalar mean = means_removed ? cv::mean(pair, mask) : cv::Scalar();
  const auto mean_real = static_cast<float>(mean[0]), mean_imaginary = static_cast<float>(mean[1]);
  const std::size_t columns = size_of(pair.cols);
  CentredPair result{ComplexImage(size_of(pair.rows), columns), 0};
  for (int r = 0; r < pair.rows; ++r) {
    const auto* values = pair.ptr<float>(r);
    const auto* valid = mask.ptr<std::uint8_t>(r);
    float *real = result.image.real(size_of(r)), *imaginary = result.image.imaginary(size_of(r));
    for (std::size_t c = 0; c < columns; ++c) {
      real[c] = valid[c] != 0 ? values[2 * c] - mean_real : 0.0F;
      imaginary[c] = valid[c] != 0 ? values[2 * c + 1] - mean_imaginary : 0.0F;
    }
    double energy = 0;
    for (std::size_t c = 0; c < columns; ++c) {
      energy += static_cast<double>(real[c]) * static_cast<double>(real[c]) +
                static_cast<double>(imaginary[c]) * static_cast<double>(imaginary[c]);
    }
    result.energy += energy;
  }
  return result;
}

ComplexImage unit_mask(const cv::Mat& mask) {
  ComplexImage unit(size_of(mask.rows), size_of(mask.cols));
  unit.clear();
  for (int r = 0; r < mask.rows; ++r) {
    const auto* valid = mask.ptr<std::uint8_t>(r);
    for (std::size_t c = 0; c < unit.columns(); ++c) unit.real(size_of(r))[c] = valid[c] != 0 ? 1.0F : 0.0F;
  }
  return unit;
}

ComplexImage cut(const ComplexImage& image, const cv::Rect& part) {
  ComplexImage result(size_of(part.height), size_of(part.width));
  for (std::size_t r = 0; r < result.rows(); ++r) {
    std::copy_n(image.real(size_of(part.y) + r) + part.x, part.width, result.real(r));
    std::copy_n(image.imaginary(size_of(part.y) + r) + part.x, part.width, result.imaginary(r));
  }
  return result;
}

// One channel of a pair as an image.
ComplexImage channel_of(const ComplexImage& pair, int channel) {
  ComplexImage result(pair.rows(), pair.columns());
  result.clear();
  for (std::size_t r = 0; r < pair.rows(); ++r) {
    std::copy_n(channel == 0 ? pair.real(r) : pair.imaginary(r), pair.columns(), result.real(r));
  }
  return result;
}

// The length of the transform that does `placements` of a template with the least work. Measured: what each number
// takes grows with the cube root of the length, more than the steps do, as more of the memory lies beyond the caches.
std::size_t part_length(int window, int pattern) {
  if (pattern <= 0) return FourierTransform::fitting_length(size_of(window));
  const int placements = std::max(1, window - pattern + 1);
  std::size_t best = 0;
  double least = 0;
  for (std::size_t length = FourierTransform::fitting_length(size_of(pattern));;
       length = FourierTransform::fitting_length(length + 1)) {
    const double each = static_cast<double>(length) - pattern + 1;
    const double work =
        std::ceil(placements / each) * static_cast<double>(length) * std::cbrt(static_cast<double>(length));
    if (best == 0 || work < least) {
      best = length;
      least = work;
    }
    if (length >= size_of(window) || length >= kMaxTransform_px) return best;
  }
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

NADIR_FOR_WIDE_REGISTERS float largest_of(const float* values, std::size_t count) {
  constexpr std::size_t kLanes = 16;
  std::array<float, kLanes> largest;
  largest.fill(values[0]);
  std::size_t i = 0;
  for (; i + kLanes <= count; i += kLanes) {
    for (std::size_t lane = 0; lane < kLanes; ++lane) largest[lane] = std::max(largest[lane], values[i + lane]);
  }
  for (; i < count; ++i) largest[0] = std::max(largest[0], values[i]);
  return *std::max_element(largest.begin(), largest.end());
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

WindowSpectra::WindowSpectra(const Channels& window, cv::Size pattern)
    : window_size_(window.mask.size()),
      pattern_(pattern),
      means_removed_(window.means_removed),
      transform_(part_length(window_size_.height, pattern.height), part_length(window_size_.width, pattern.width)) {
  std::vector<ComplexImage> images;
  ComplexImage energy_and_valid(size_of(window_size_.height), size_of(window_size_.width));
  energy_and_valid.clear();
  for (const cv::Mat& pair : window.pairs) {
    images.push_back(centred(pair, window.mask, means_removed_).image);
    for (std::size_t r = 0; r < energy_and_valid.rows(); ++r) {
      const float *real = images.back().real(r), *imaginary = images.back().imaginary(r);
      float* energy = energy_and_valid.real(r);
      for (std::size_t c = 0; c < energy_and_valid.columns(); ++c) {
        energy[c] += real[c] * real[c] + imaginary[c] * imaginary[c];
      }
    }
  }
  for (int r = 0; r < window_size_.height; ++r) {
    const auto* valid = window.mask.ptr<std::uint8_t>(r);
    float* out = energy_and_valid.imaginary(size_of(r));
    for (int c = 0; c < window_size_.width; ++c) out[c] = valid[c] != 0 ? 1.0F : 0.0F;
  }
  const cv::Rect whole(cv::Point(), window_size_);
  const auto columns = static_cast<int>(transform_.columns()), rows = static_cast<int>(transform_.rows());
  const cv::Rect all(cv::Point(), pattern.empty() ? window_size_ : placements_of(window_size_, pattern));
  const int across = pattern.empty() ? columns : columns - pattern.width + 1;
  const int down = pattern.empty() ? rows : rows - pattern.height + 1;
  for (int y = 0; y < all.height; y += down) {
    for (int x = 0; x < all.width; x += across) {
      const cv::Rect shown = cv::Rect(x, y, columns, rows) & whole;
      Part part{cv::Rect(x, y, across, down) & all, {}, transform_.forward(cut(energy_and_valid, shown))};
      for (const ComplexImage& image : images) {
        for (const int channel : {0, 1}) {
          part.channels.push_back(transform_.forward(channel_of(cut(image, shown), channel)));
        }
      }
      parts_.push_back(std::move(part));
    }
  }
}

TemplateNorm::TemplateNorm(const Channels& shape, const WindowSpectra& window, double min_valid)
    : template_size_(shape.mask.size()) {
  const cv::Size placements = placements_of(window.window_size_, template_size_);
  CV_Assert(placements.width > 0 && placements.height > 0);
  CV_Assert(window.pattern_.empty() || window.pattern_ == template_size_);
  const FourierTransform& transform = window.transform_;
  const Spectrum mask = transform.forward(unit_mask(shape.mask));
  const float scale = 1.0F / static_cast<float>(transform.rows() * transform.columns());
  const auto area = static_cast<float>(std::max(1, cv::countNonZero(shape.mask)));
  const auto needed = static_cast<float>(min_valid) * area;
  inverse_norm_.create(placements, CV_32FC1);
  for (const WindowSpectra::Part& part : window.parts_) {
    const cv::Rect here = part.placements & cv::Rect(cv::Point(), placements);
    if (here.empty()) continue;
    const auto placed = [&](const Spectrum& spectrum) {
      return transform.correlation({&spectrum, 1}, {&mask, 1}, size_of(here.height), size_of(here.width));
    };
    const ComplexImage sums = placed(part.energy_and_valid);
    cv::Mat means_squared = cv::Mat::zeros(here.size(), CV_32FC1);
    for (const Spectrum& channel : part.channels) {
      if (!window.means_removed_) break;
      const ComplexImage sum = placed(channel);
      for (int r = 0; r < here.height; ++r) {
        const float* real = sum.real(size_of(r));
        auto* to = means_squared.ptr<float>(r);
        for (int c = 0; c < here.width; ++c) to[c] += (real[c] * scale) * (real[c] * scale);
      }
    }
    for (int r = 0; r < here.height; ++r) {
      const float *energies = sums.real(size_of(r)), *valids = sums.imaginary(size_of(r));
      const auto* squared = means_squared.ptr<float>(r);
      auto* out = inverse_norm_.ptr<float>(here.y + r) + here.x;
      for (int c = 0; c < here.width; ++c) {
        const float valid = valids[c] * scale;
        const float variance = energies[c] * scale - squared[c] / std::max(valid, 1.0F);
        // A placement half off the map has little energy: scale it to the whole area, so that it is not favoured.
        out[c] = valid < needed || variance < static_cast<float>(kMinVariance) * area
                     ? 0.0F
                     : std::sqrt(valid / area) / std::sqrt(variance);
      }
    }
  }
}

TemplateSpectra::TemplateSpectra(const Channels& one, const Channels* other, const WindowSpectra& window)
    : template_size_(one.mask.size()), window_size_(window.window_size_) {
  const FourierTransform& transform = window.transform_;
  CV_Assert(other == nullptr || other->mask.size() == template_size_);
  std::vector<double> energies(other == nullptr ? 1 : 2);
  for (std::size_t p = 0; p < one.pairs.size(); ++p) {
    std::vector<CentredPair> both;
    for (const Channels* pattern : {&one, other}) {
      if (pattern == nullptr) continue;
      CV_Assert(2 * pattern->pairs.size() == window.parts_.front().channels.size());
      both.push_back(centred(pattern->pairs[p], pattern->mask, window.means_removed_));
      energies[both.size() - 1] += both.back().energy;
    }
    for (const int channel : {0, 1}) {
      ComplexImage image = channel_of(both[0].image, channel);
      for (std::size_t r = 0; other != nullptr && r < image.rows(); ++r) {
        const float* from = channel == 0 ? both[1].image.real(r) : both[1].image.imaginary(r);
        std::transform(from, from + image.columns(), image.imaginary(r), std::negate<>());
      }
      channels_.push_back(transform.forward(image));
    }
  }
  const double area = static_cast<double>(transform.rows() * transform.columns());
  for (const double energy : energies) {
    inverse_norms_.push_back(static_cast<float>(energy > kMinTemplateEnergy ? 1.0 / (std::sqrt(energy) * area) : 0.0));
  }
}

std::vector<cv::Mat> TemplateSpectra::scores(const WindowSpectra& window, const TemplateNorm& norm) const {
  CV_Assert(norm.template_size_ == template_size_ && window.window_size_ == window_size_);
  const FourierTransform& transform = window.transform_;
  std::vector<cv::Mat> surfaces;
  for (std::size_t i = 0; i < inverse_norms_.size(); ++i) surfaces.emplace_back(norm.inverse_norm_.size(), CV_32FC1);
  for (const WindowSpectra::Part& part : window.parts_) {
    const cv::Rect here = part.placements & cv::Rect(cv::Point(), norm.inverse_norm_.size());
    if (here.empty()) continue;
    const ComplexImage placed =
        transform.correlation(part.channels, channels_, size_of(here.height), size_of(here.width));
    for (std::size_t i = 0; i < surfaces.size(); ++i) {
      const float inverse_norm = inverse_norms_[i];
      for (int r = 0; r < here.height; ++r) {
        const float* from = i == 0 ? placed.real(size_of(r)) : placed.imaginary(size_of(r));
        const auto* factor = norm.inverse_norm_.ptr<float>(here.y + r) + here.x;
        auto* to = surfaces[i].ptr<float>(here.y + r) + here.x;
        for (int c = 0; c < here.width; ++c) to[c] = factor[c] > 0 ? from[c] * factor[c] * inverse_norm : -1.0F;
      }
    }
  }
  return surfaces;
}

cv::Mat correlate(const Channels& pattern, const WindowSpectra& window, const TemplateNorm& norm) {
  return TemplateSpectra(pattern, nullptr, window).scores(window, norm).front();
}

Peak best_peak(const cv::Mat& scores) {
  cv::Point at;
  cv::minMaxLoc(scores, nullptr, nullptr, nullptr, &at);
  return refined_peak(scores, at);
}

namespace {

// The largest values of rows, from which the largest of all is found again after a few rows have changed.
class RowMaxima {
 public:
  explicit RowMaxima(const cv::Mat& scores) : scores_(scores), largest_(size_of(scores.rows)) {
    update(0, scores.rows);
  }

  void update(int from, int to) {
    for (int r = std::max(0, from); r < std::min(scores_.rows, to); ++r) {
      largest_[size_of(r)] = largest_of(scores_.ptr<float>(r), size_of(scores_.cols));
    }
  }
  // The first of the largest, row by row.
  cv::Point at() const {
    const auto row = std::max_element(largest_.begin(), largest_.end()) - largest_.begin();
    const auto* values = scores_.ptr<float>(static_cast<int>(row));
    return {
        static_cast<int>(std::find(values, values + scores_.cols, largest_[static_cast<std::size_t>(row)]) - values),
        static_cast<int>(row)};
  }

 private:
  const cv::Mat& scores_;
  std::vector<float> largest_;
};

}  // namespace

std::vector<Peak> distinct_peaks(const cv::Mat& scores, std::size_t count, double min_distance_px) {
  std::vector<Peak> peaks;
  cv::Mat left = scores.clone();
  RowMaxima maxima(left);
  const int radius = static_cast<int>(std::ceil(min_distance_px));
  while (peaks.size() < count) {
    const cv::Point at = maxima.at();
    if (left.at<float>(at) <= 0) break;
    peaks.push_back(refined_peak(scores, at));
    cv::circle(left, at, radius, cv::Scalar(-1), cv::FILLED);
    maxima.update(at.y - radius - 1, at.y + radius + 2);
  }
  return peaks;
}

// Of the runs of a template, so many numbers side by side: whole pixels of two channels and of six.
struct LocalTemplate::RunSums {
  static constexpr std::size_t kLanes = 48;
  std::array<std::int64_t, kLanes> values{}, squares{};

  NADIR_FOR_WIDE_REGISTERS void add(const std::int16_t* of, std::size_t count);
};

NADIR_FOR_WIDE_REGISTERS void LocalTemplate::RunSums::add(const std::int16_t* of, std::size_t count) {
  std::array<std::int32_t, kLanes> sums{}, sums_of_squares{};
  const auto add_one = [&](std::size_t lane, std::int16_t value) {
    sums[lane] += value;
    sums_of_squares[lane] += value * value;
  };
  std::size_t i = 0;
  for (; i + kLanes <= count; i += kLanes) {
    for (std::size_t lane = 0; lane < kLanes; ++lane) add_one(lane, of[i + lane]);
  }
  for (std::size_t lane = 0; i < count; ++i, ++lane) add_one(lane, of[i]);
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    values[lane] += sums[lane];
    squares[lane] += sums_of_squares[lane];
  }
}

LocalTemplate::LocalTemplate(const QuantizedChannels& of, const cv::Rect& part)
    : part_(part), channels_(of.channels()), means_removed_(of.means_removed()), sums_(of.channels()) {
  CV_Assert((part & cv::Rect(cv::Point(), of.size())) == part && part.height <= kMaxRows);
  RunSums sums;
  for (int row = 0; row < part.height; ++row) {
    const auto* valid = of.mask().ptr<std::uint8_t>(part.y + row) + part.x;
    for (int begin = 0; begin < part.width;) {
      if (valid[begin] == 0) {
        ++begin;
        continue;
      }
      int end = begin + 1;
      while (end < part.width && valid[end] != 0) ++end;
      add_run(row, begin, end, of.at(part.y + row, part.x + begin), sums);
      begin = end;
    }
  }
  for (std::size_t lane = 0; lane < RunSums::kLanes; ++lane) {
    sums_[lane % channels_] += static_cast<double>(sums.values[lane]);
    energy_ += static_cast<double>(sums.squares[lane]);
  }
  if (!means_removed_) std::fill(sums_.begin(), sums_.end(), 0.0);
  for (const double sum : sums_) energy_ -= sum * sum / std::max(1.0, pixels_);
}

void LocalTemplate::add_run(int row, int begin, int end, const std::int16_t* values, RunSums& sums) {
  const std::size_t length = static_cast<std::size_t>(end - begin) * channels_;
  const std::size_t blocks = (length + kProductBlock - 1) / kProductBlock;
  runs_.push_back({row, begin, end, values_.size(), blocks});
  values_.insert(values_.end(), values, values + length);
  values_.resize(runs_.back().at + blocks * kProductBlock);
  sums.add(values, length);
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
