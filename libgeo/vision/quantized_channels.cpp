#include "vision/quantized_channels.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>
#include <utility>
#include <vector>

#include "base/platform.hpp"

namespace nadir {
namespace {

constexpr float kScale = 256;
constexpr int kMaxQuantized = 511;
constexpr std::size_t kReadBeyond = 16;  // values that a reader of sixteen at a time may read beyond the last
constexpr int kPairs = 3;                // of the six orientations
constexpr int kMaxUnsmoothed = 2047;     // 8 in steps of 1/256: sixteen of them fit into 16 bits
constexpr int kGradientSteps = 256;      // per grey level and pixel
constexpr int kStrengthSteps = 64;       // likewise; five of the strongest fit into 16 bits

// A row of a pair of channels in integer steps, less the mean at each position.
void quantize(const float* values, const float* mean, std::size_t count, std::int16_t* whole) {
  for (std::size_t i = 0; i < count; ++i) {
    const float scaled = values[i] * kScale - mean[i];
    const auto rounded = static_cast<std::int32_t>(scaled + std::copysign(0.5F, scaled));
    whole[i] = static_cast<std::int16_t>(std::min(std::max(rounded, -kMaxQuantized), kMaxQuantized));
  }
}

// ---- rows of the integer pipeline, each pixel by itself: whatever the width of the registers, the bits are the same

// OpenCV's BORDER_REFLECT_101.
int reflected(int i, int count) {
  if (count == 1) return 0;
  while (i < 0 || i >= count) i = i < 0 ? -i : 2 * (count - 1) - i;
  return i;
}

// A row with two reflected values on each side; [0] is the first of the row itself.
template <typename Value>
class PaddedRow {
 public:
  explicit PaddedRow(int columns) : columns_(columns), values_(static_cast<std::size_t>(columns) + 4) {}
  Value* begin() { return values_.data() + 2; }
  const Value* padded() {
    Value* row = begin();
    for (const int i : {-2, -1, columns_, columns_ + 1}) row[i] = row[reflected(i, columns_)];
    return row;
  }

 private:
  int columns_;
  std::vector<Value> values_;
};

// 1 4 6 4 1 along a row of grey levels: sixteenths.
NADIR_FOR_WIDE_REGISTERS void binomial_of_grey(const std::uint8_t* g, int columns, std::int16_t* out) {
  for (int c = 0; c < columns; ++c) {
    out[c] = static_cast<std::int16_t>(g[c - 2] + g[c + 2] + 4 * (g[c - 1] + g[c + 1]) + 6 * g[c]);
  }
}

// 1 4 6 4 1 over five rows of sixteenths: 1/32 of a grey level.
NADIR_FOR_WIDE_REGISTERS void binomial_to_32nds(const std::array<const std::int16_t*, 5>& rows, int columns,
                                                std::int16_t* out) {
  const std::int16_t *a = rows[0], *b = rows[1], *m = rows[2], *d = rows[3], *e = rows[4];
  for (int c = 0; c < columns; ++c) {
    const auto sum = static_cast<std::uint16_t>(a[c] + e[c] + 4 * (b[c] + d[c]) + 6 * m[c] + 4);  // at most 65284
    out[c] = static_cast<std::int16_t>(sum >> 3);
  }
}

// Sobel's operator: gradients in 1/256 grey level per pixel. And their length.
NADIR_FOR_WIDE_REGISTERS void gradients(const std::int16_t* above, const std::int16_t* here, const std::int16_t* below,
                                        int columns, std::int16_t* gx, std::int16_t* gy, std::uint16_t* strength) {
  for (int c = 0; c < columns; ++c) {
    gx[c] = static_cast<std::int16_t>(above[c + 1] - above[c - 1] + 2 * (here[c + 1] - here[c - 1]) + below[c + 1] -
                                      below[c - 1]);
    gy[c] = static_cast<std::int16_t>(below[c - 1] - above[c - 1] + 2 * (below[c] - above[c]) + below[c + 1] -
                                      above[c + 1]);
  }
  for (int c = 0; c < columns; ++c) {
    const auto x = static_cast<float>(gx[c]), y = static_cast<float>(gy[c]);
    const float length = std::sqrt(x * x + y * y) * (static_cast<float>(kStrengthSteps) / kGradientSteps);
    strength[c] = static_cast<std::uint16_t>(static_cast<std::int32_t>(length + 0.5F));
  }
}

constexpr std::uint32_t kFifth = 13107;  // of 65536

NADIR_FOR_WIDE_REGISTERS void mean_of_five_along(const std::uint16_t* s, int columns, std::uint16_t* out) {
  for (int c = 0; c < columns; ++c) {
    const auto sum = static_cast<std::uint16_t>(s[c - 2] + s[c - 1] + s[c] + s[c + 1] + s[c + 2]);
    out[c] = static_cast<std::uint16_t>((sum * kFifth) >> 16U);
  }
}

NADIR_FOR_WIDE_REGISTERS void mean_of_five_rows(const std::array<const std::uint16_t*, 5>& rows, int columns,
                                                std::uint16_t* out) {
  const std::uint16_t *a = rows[0], *b = rows[1], *m = rows[2], *d = rows[3], *e = rows[4];
  for (int c = 0; c < columns; ++c) {
    const auto sum = static_cast<std::uint16_t>(a[c] + b[c] + m[c] + d[c] + e[c]);
    out[c] = static_cast<std::uint16_t>((sum * kFifth) >> 16U);
  }
}

// Strength over (local strength + floor), times the cosine of twice the angle to each orientation, squared with its
// sign: perpendicular orientations share a value, the one has the positive part, the other the negative.
inline std::int16_t squared_with_sign(float value, float weight) {
  constexpr float kLimit = kMaxUnsmoothed;
  const float scaled = value * std::abs(value) * weight;
  const float limited = scaled < kLimit ? scaled : kLimit;
  return static_cast<std::int16_t>(static_cast<std::int32_t>(limited > -kLimit ? limited : -kLimit));
}

// Cosine and sine of twice the angle of the second and the third pair; the first pair's is 0.
struct TwiceTheAngle {
  float cos1, sin1, cos2, sin2;
};

NADIR_FOR_WIDE_REGISTERS void orientations(const std::int16_t* gx, const std::int16_t* gy, const std::uint16_t* local,
                                           float floor, TwiceTheAngle turn, int columns, std::int16_t* __restrict first,
                                           std::int16_t* __restrict second, std::int16_t* __restrict third) {
  const float cos1 = turn.cos1, sin1 = turn.sin1, cos2 = turn.cos2, sin2 = turn.sin2;
  constexpr float kOne = kScale * static_cast<float>(kStrengthSteps) / kGradientSteps;
  for (int c = 0; c < columns; ++c) {
    const auto x = static_cast<float>(gx[c]), y = static_cast<float>(gy[c]);
    const float x2 = x * x, y2 = y * y, squared = x2 + y2 + 1e-3F;  // a step of the gradient is 1
    const float weight = kOne * std::sqrt(squared) / ((static_cast<float>(local[c]) + floor) * squared * squared);
    const float along = x2 - y2, across = 2 * x * y;
    const float one = along * cos1 + across * sin1, two = along * cos2 + across * sin2;
    first[c] = squared_with_sign(along, weight);
    second[c] = squared_with_sign(one, weight);
    third[c] = squared_with_sign(two, weight);
  }
}

template <typename Value>
void clear_masked(const std::uint8_t* mask, int columns, Value* values) {
  for (int c = 0; c < columns; ++c) values[c] = mask[c] != 0 ? values[c] : Value{0};
}

NADIR_FOR_WIDE_REGISTERS void parts_of(const std::int16_t* both, int columns, std::int16_t* positive,
                                       std::int16_t* negative) {
  for (int c = 0; c < columns; ++c) {
    positive[c] = std::max<std::int16_t>(both[c], 0);
    negative[c] = std::max<std::int16_t>(static_cast<std::int16_t>(-both[c]), 0);
  }
}

NADIR_FOR_WIDE_REGISTERS void binomial_along(const std::int16_t* v, int columns, std::int16_t* out) {
  for (int c = 0; c < columns; ++c) {
    const auto sum = static_cast<std::int16_t>(v[c - 2] + v[c + 2] + 4 * (v[c - 1] + v[c + 1]) + 6 * v[c] + 8);
    out[c] = static_cast<std::int16_t>(sum >> 4);
  }
}

NADIR_FOR_WIDE_REGISTERS void binomial_of_rows(const std::array<const std::int16_t*, 5>& rows, std::int16_t mean,
                                               int columns, std::int16_t* out) {
  const std::int16_t *a = rows[0], *b = rows[1], *m = rows[2], *d = rows[3], *e = rows[4];
  constexpr std::int16_t kLimit = kMaxQuantized;
  for (int c = 0; c < columns; ++c) {
    const auto sum = static_cast<std::int16_t>(a[c] + e[c] + 4 * (b[c] + d[c]) + 6 * m[c] + 8);
    const auto centred = static_cast<std::int16_t>(static_cast<std::int16_t>(sum >> 4) - mean);
    out[c] = std::clamp<std::int16_t>(centred, -kLimit, kLimit);
  }
}

NADIR_FOR_WIDE_REGISTERS std::int32_t sum_of(const std::int16_t* values, int columns) {
  std::int32_t sum = 0;
  for (int c = 0; c < columns; ++c) sum += values[c];
  return sum;
}

NADIR_FOR_WIDE_REGISTERS std::uint32_t sum_of(const std::uint16_t* values, int columns) {
  std::uint32_t sum = 0;
  for (int c = 0; c < columns; ++c) sum += values[c];
  return sum;
}

// Six rows side by side, pixel by pixel; a pair of them is written as one number of 32 bits.
using BothOfAPair [[gnu::may_alias]] = std::uint32_t;
NADIR_FOR_WIDE_REGISTERS void interleave(const std::array<const std::int16_t*, 6>& rows, int columns,
                                         BothOfAPair* out) {
  const std::int16_t *a = rows[0], *b = rows[1], *c = rows[2], *d = rows[3], *e = rows[4], *f = rows[5];
  const auto both = [](std::int16_t low, std::int16_t high) {
    return static_cast<std::uint32_t>(static_cast<std::uint16_t>(low)) |
           static_cast<std::uint32_t>(static_cast<std::uint16_t>(high)) << 16U;
  };
  for (int i = 0; i < columns; ++i) {
    out[3 * i] = both(a[i], b[i]);
    out[3 * i + 1] = both(c[i], d[i]);
    out[3 * i + 2] = both(e[i], f[i]);
  }
}

NADIR_FOR_WIDE_REGISTERS void add_rows(const std::int16_t* one, const std::int16_t* other, std::size_t count,
                                       std::int16_t* sum) {
  for (std::size_t i = 0; i < count; ++i) sum[i] = static_cast<std::int16_t>(one[i] + other[i]);
}

// Of neighbouring pixels of a row of sums of two.
template <std::size_t kChannels>
void mean_of_four(const std::int16_t* both, std::size_t columns, std::int16_t* mean) {
  for (std::size_t c = 0; c < columns; ++c, both += 2 * kChannels, mean += kChannels) {
    for (std::size_t k = 0; k < kChannels; ++k) {
      mean[k] = static_cast<std::int16_t>((both[k] + both[kChannels + k] + 2) >> 2);
    }
  }
}

// An image of one type in one block.
template <typename Value>
class Plane {
 public:
  Plane(int rows, int columns)
      : rows_(rows),
        columns_(columns),
        values_(std::make_unique_for_overwrite<Value[]>(static_cast<std::size_t>(rows) *
                                                        static_cast<std::size_t>(columns))) {}
  Value* row(int r) { return values_.get() + static_cast<std::size_t>(r) * static_cast<std::size_t>(columns_); }
  std::array<const Value*, 5> around(int r) {
    std::array<const Value*, 5> five{};
    for (int i = 0; i < 5; ++i) five[static_cast<std::size_t>(i)] = row(reflected(r + i - 2, rows_));
    return five;
  }

 private:
  int rows_, columns_;
  std::unique_ptr<Value[]> values_;
};

struct Gradients {
  Plane<std::int16_t> x, y;
  Plane<std::uint16_t> strength;
};

Gradients gradients_of(const cv::Mat& grey) {
  const int rows = grey.rows, columns = grey.cols;
  Plane<std::int16_t> along(rows, columns);
  PaddedRow<std::uint8_t> levels(columns);
  for (int r = 0; r < rows; ++r) {
    std::copy_n(grey.ptr<std::uint8_t>(r), columns, levels.begin());
    binomial_of_grey(levels.padded(), columns, along.row(r));
  }
  Gradients result{{rows, columns}, {rows, columns}, {rows, columns}};
  std::array<PaddedRow<std::int16_t>, 3> smooth{PaddedRow<std::int16_t>(columns), PaddedRow<std::int16_t>(columns),
                                                PaddedRow<std::int16_t>(columns)};
  const auto smoothed = [&](int r) -> const std::int16_t* {
    PaddedRow<std::int16_t>& row = smooth[static_cast<std::size_t>(r % 3)];
    binomial_to_32nds(along.around(r), columns, row.begin());
    return row.padded();
  };
  std::array<const std::int16_t*, 3> made{};
  for (int r = 0; r < std::min(2, rows); ++r) made[static_cast<std::size_t>(r)] = smoothed(r);
  for (int r = 0; r < rows; ++r) {
    if (r + 1 < rows && r > 0) made[static_cast<std::size_t>((r + 1) % 3)] = smoothed(r + 1);
    const auto at = [&](int i) { return made[static_cast<std::size_t>(reflected(i, rows) % 3)]; };
    gradients(at(r - 1), at(r), at(r + 1), columns, result.x.row(r), result.y.row(r), result.strength.row(r));
  }
  return result;
}

// Two means of five after each other, in both directions.
Plane<std::uint16_t> pooled_strength(Plane<std::uint16_t>& strength, int rows, int columns) {
  Plane<std::uint16_t> once(rows, columns), twice(rows, columns);
  PaddedRow<std::uint16_t> row(columns);
  for (int r = 0; r < rows; ++r) {
    std::copy_n(strength.row(r), columns, row.begin());
    mean_of_five_along(row.padded(), columns, once.row(r));
    std::copy_n(once.row(r), columns, row.begin());
    mean_of_five_along(row.padded(), columns, once.row(r));
  }
  for (int r = 0; r < rows; ++r) mean_of_five_rows(once.around(r), columns, twice.row(r));
  for (int r = 0; r < rows; ++r) mean_of_five_rows(twice.around(r), columns, once.row(r));
  return once;
}

TwiceTheAngle turn_of_pairs() {
  constexpr double kApart = std::numbers::pi / kPairs;
  return {static_cast<float>(std::cos(kApart)), static_cast<float>(std::sin(kApart)),
          static_cast<float>(std::cos(2 * kApart)), static_cast<float>(std::sin(2 * kApart))};
}

}  // namespace

QuantizedChannels::QuantizedChannels(cv::Mat mask, std::size_t channels, bool means_removed)
    : mask_(std::move(mask)),
      channels_(channels),
      means_removed_(means_removed),
      whole_(cv::countNonZero(mask_) == static_cast<int>(mask_.total())),
      values_(std::make_unique_for_overwrite<std::int16_t[]>(mask_.total() * channels + kReadBeyond)) {
  std::fill_n(values_.get() + mask_.total() * channels_, kReadBeyond, std::int16_t{0});
}

QuantizedChannels::QuantizedChannels(const Channels& channels)
    : QuantizedChannels(channels.mask, 2 * channels.pairs.size(), channels.means_removed) {
  CV_Assert(channels_ == 2 || channels_ == 6);
  const auto columns = static_cast<std::size_t>(mask_.cols);
  // What is not valid counts as the mean, which is then 0.
  std::vector<float> mean(columns * channels_);
  for (std::size_t p = 0; p < channels.pairs.size(); ++p) {
    const cv::Scalar both = means_removed_ ? cv::mean(channels.pairs[p], mask_) : cv::Scalar();
    for (std::size_t i = 0; i < 2 * columns; ++i) {
      mean[2 * columns * p + i] = std::round(static_cast<float>(both[static_cast<int>(i % 2)]) * kScale);
    }
  }
  std::vector<std::int16_t> pair_values(2 * columns);
  for (int r = 0; r < mask_.rows; ++r) {
    const auto* valid = mask_.ptr<std::uint8_t>(r);
    std::int16_t* value = values_.get() + static_cast<std::size_t>(r) * columns * channels_;
    for (std::size_t p = 0; p < channels.pairs.size(); ++p) {
      quantize(channels.pairs[p].ptr<float>(r), mean.data() + 2 * columns * p, 2 * columns, pair_values.data());
      for (std::size_t c = 0; c < columns; ++c) {
        const bool keep = valid[c] != 0;
        value[c * channels_ + 2 * p] = keep ? pair_values[2 * c] : std::int16_t{0};
        value[c * channels_ + 2 * p + 1] = keep ? pair_values[2 * c + 1] : std::int16_t{0};
      }
    }
  }
}

QuantizedChannels QuantizedChannels::halved(cv::Point first) const {
  const int rows = (mask_.rows - first.y) / 2, columns = (mask_.cols - first.x) / 2;
  cv::Mat mask(rows, columns, CV_8UC1, cv::Scalar(255));
  if (!whole_) {
    for (int r = 0; r < rows; ++r) {
      const auto *above = mask_.ptr<std::uint8_t>(2 * r + first.y) + first.x,
                 *below = mask_.ptr<std::uint8_t>(2 * r + 1 + first.y) + first.x;
      auto* out = mask.ptr<std::uint8_t>(r);
      for (int c = 0; c < columns; ++c) out[c] = above[2 * c] & above[2 * c + 1] & below[2 * c] & below[2 * c + 1];
    }
  }
  QuantizedChannels half(mask, channels_, means_removed_);
  std::vector<std::int16_t> both(2 * static_cast<std::size_t>(columns) * channels_);
  for (int r = 0; r < rows; ++r) {
    add_rows(at(2 * r + first.y, first.x), at(2 * r + 1 + first.y, first.x), both.size(), both.data());
    std::int16_t* out =
        half.values_.get() + static_cast<std::size_t>(r) * static_cast<std::size_t>(columns) * channels_;
    (channels_ == 6 ? mean_of_four<6> : mean_of_four<2>)(both.data(), static_cast<std::size_t>(columns), out);
    if (half.whole_) continue;
    const auto* valid = mask.ptr<std::uint8_t>(r);
    for (int c = 0; c < columns; ++c) {
      if (valid[c] == 0) std::fill_n(out + static_cast<std::size_t>(c) * channels_, channels_, std::int16_t{0});
    }
  }
  return half;
}

QuantizedChannels quantized_channels(const cv::Mat& grey, const cv::Mat& mask, ChannelSet set,
                                     const ChannelOptions& options) {
  const bool usual = set == ChannelSet::six_orientations && options.sigma_px == kChannelSigma_px &&
                     options.pool_px == kChannelPool_px && grey.rows > 1 && grey.cols > 1;
  if (!usual) return QuantizedChannels(oriented_channels(grey, mask, set, options));

  QuantizedChannels result(usable_part(mask, grey.size(), options), 2 * kPairs, options.means_removed);
  const int rows = grey.rows, columns = grey.cols;
  Gradients gradient = gradients_of(grey);
  std::uint64_t strength = 0;
  for (int r = 0; r < rows; ++r) {
    if (!result.whole_) {
      clear_masked(result.mask_.ptr<std::uint8_t>(r), columns, gradient.strength.row(r));
    }
    strength += sum_of(gradient.strength.row(r), columns);
  }
  const double pixels = std::max(1, cv::countNonZero(result.mask_));
  const auto floor = static_cast<float>(options.floor_fraction * static_cast<double>(strength) / pixels +
                                        kStrengthEpsilon * kStrengthSteps);
  Plane<std::uint16_t> local = pooled_strength(gradient.strength, rows, columns);

  const TwiceTheAngle turn = turn_of_pairs();
  std::vector<Plane<std::int16_t>> planes;
  for (int k = 0; k < 2 * kPairs; ++k) planes.emplace_back(rows, columns);
  std::array<std::int64_t, 2 * kPairs> sums{};
  std::vector<std::vector<std::int16_t>> signed_rows(kPairs,
                                                     std::vector<std::int16_t>(static_cast<std::size_t>(columns)));
  std::vector<PaddedRow<std::int16_t>> parts(2, PaddedRow<std::int16_t>(columns));
  for (int r = 0; r < rows; ++r) {
    orientations(gradient.x.row(r), gradient.y.row(r), local.row(r), floor, turn, columns, signed_rows[0].data(),
                 signed_rows[1].data(), signed_rows[2].data());
    for (std::size_t p = 0; p < kPairs; ++p) {
      std::int16_t* both = signed_rows[p].data();
      // Else the border of the valid area is smoothed inwards.
      if (!result.whole_) clear_masked(result.mask_.ptr<std::uint8_t>(r), columns, both);
      parts_of(both, columns, parts[0].begin(), parts[1].begin());
      for (std::size_t side = 0; side < 2; ++side) {
        sums[2 * p + side] += sum_of(parts[side].begin(), columns);
        binomial_along(parts[side].padded(), columns, planes[2 * p + side].row(r));
      }
    }
  }
  std::array<std::int16_t, 2 * kPairs> mean{};  // smoothing keeps the sum
  for (std::size_t k = 0; k < mean.size(); ++k) {
    if (options.means_removed) mean[k] = static_cast<std::int16_t>(std::lround(static_cast<double>(sums[k]) / pixels));
  }
  std::vector<std::vector<std::int16_t>> smooth(2 * kPairs,
                                                std::vector<std::int16_t>(static_cast<std::size_t>(columns)));
  for (int r = 0; r < rows; ++r) {
    for (std::size_t k = 0; k < smooth.size(); ++k) {
      binomial_of_rows(planes[k].around(r), mean[k], columns, smooth[k].data());
      if (!result.whole_) clear_masked(result.mask_.ptr<std::uint8_t>(r), columns, smooth[k].data());
    }
    auto* out = reinterpret_cast<BothOfAPair*>(result.values_.get() +
                                               static_cast<std::size_t>(r) * static_cast<std::size_t>(columns) * 6);
    interleave(
        {smooth[0].data(), smooth[1].data(), smooth[2].data(), smooth[3].data(), smooth[4].data(), smooth[5].data()},
        columns, out);
  }
  return result;
}

}  // namespace nadir
