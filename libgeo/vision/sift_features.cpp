#include "vision/sift_features.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <numbers>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <span>
#include <tuple>
#include <utility>

#include "base/platform.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {
namespace {

std::size_t index_of(int i) { return static_cast<std::size_t>(i); }

// ---- Gaussian scales

class ScaleImage {
 public:
  ScaleImage(int rows, int columns)
      : rows_(rows), columns_(columns), values_(std::make_unique_for_overwrite<float[]>(index_of(rows * columns))) {}

  int rows() const { return rows_; }
  int columns() const { return columns_; }
  float* row(int r) { return values_.get() + index_of(r) * index_of(columns_); }
  const float* row(int r) const { return values_.get() + index_of(r) * index_of(columns_); }
  float at(int r, int c) const { return row(r)[c]; }

 private:
  int rows_, columns_;
  std::unique_ptr<float[]> values_;
};

constexpr int kMaxBlurReach_px = 16;

// Half of a symmetric kernel: the middle's weight first.
std::vector<float> gaussian_weights(double sigma_px) {
  const int reach = std::min(kMaxBlurReach_px, static_cast<int>(std::ceil(kSiftBlurReach * sigma_px)));
  std::vector<double> weights;
  double sum = 0;
  for (int i = 0; i <= reach; ++i) {
    weights.push_back(std::exp(-0.5 * i * i / (sigma_px * sigma_px)));
    sum += i == 0 ? weights.back() : 2 * weights.back();
  }
  std::vector<float> result;
  for (const double weight : weights) result.push_back(static_cast<float>(weight / sum));
  return result;
}

// before[i] and after[i]: i + 1 pixels before and after the middle's, above and below or to the left and right.
struct BlurTaps {
  const float* middle = nullptr;
  std::array<const float*, kMaxBlurReach_px> before{}, after{};
};

template <std::size_t kReach>
[[gnu::always_inline]] inline void blur_with(const BlurTaps& taps, const float* weights, int count,
                                             float* __restrict out) {
  std::array<float, kReach + 1> weight;
  std::array<const float*, kReach> before, after;
  std::copy_n(weights, weight.size(), weight.begin());
  std::copy_n(taps.before.begin(), kReach, before.begin());
  std::copy_n(taps.after.begin(), kReach, after.begin());
  const float* middle = taps.middle;
  for (int c = 0; c < count; ++c) {
    float sum = weight[0] * middle[c];
#pragma GCC unroll 16
    for (std::size_t k = 0; k < kReach; ++k) sum += weight[k + 1] * (before[k][c] + after[k][c]);
    out[c] = sum;
  }
}

NADIR_FOR_WIDE_REGISTERS void blur_line(const BlurTaps& taps, const float* weights, int reach, int count, float* out) {
  switch (reach) {
    case 1: return blur_with<1>(taps, weights, count, out);
    case 2: return blur_with<2>(taps, weights, count, out);
    case 3: return blur_with<3>(taps, weights, count, out);
    case 4: return blur_with<4>(taps, weights, count, out);
    case 5: return blur_with<5>(taps, weights, count, out);
    case 6: return blur_with<6>(taps, weights, count, out);
    case 7: return blur_with<7>(taps, weights, count, out);
    case 8: return blur_with<8>(taps, weights, count, out);
    case 9: return blur_with<9>(taps, weights, count, out);
    case 10: return blur_with<10>(taps, weights, count, out);
    case 11: return blur_with<11>(taps, weights, count, out);
    case 12: return blur_with<12>(taps, weights, count, out);
    case 13: return blur_with<13>(taps, weights, count, out);
    case 14: return blur_with<14>(taps, weights, count, out);
    case 15: return blur_with<15>(taps, weights, count, out);
    default: return blur_with<16>(taps, weights, count, out);
  }
}

int mirrored(int i, int count) {
  while (i < 0 || i >= count) i = i < 0 ? -i : 2 * (count - 1) - i;
  return i;
}

ScaleImage blurred(const ScaleImage& image, double sigma_px) {
  const std::vector<float> weights = gaussian_weights(sigma_px);
  const int reach = static_cast<int>(weights.size()) - 1, columns = image.columns();
  ScaleImage result(image.rows(), columns);
  std::vector<float> line(index_of(columns + 2 * kMaxBlurReach_px));
  float* begin = line.data() + kMaxBlurReach_px;
  BlurTaps along;
  along.middle = begin;
  for (int i = 0; i < reach; ++i) {
    along.before[index_of(i)] = begin - i - 1;
    along.after[index_of(i)] = begin + i + 1;
  }
  for (int r = 0; r < image.rows(); ++r) {
    BlurTaps across;
    across.middle = image.row(r);
    for (int i = 0; i < reach; ++i) {
      across.before[index_of(i)] = image.row(mirrored(r - i - 1, image.rows()));
      across.after[index_of(i)] = image.row(mirrored(r + i + 1, image.rows()));
    }
    blur_line(across, weights.data(), reach, columns, begin);
    for (int i = 1; i <= reach; ++i) {
      begin[-i] = begin[mirrored(-i, columns)];
      begin[columns - 1 + i] = begin[mirrored(columns - 1 + i, columns)];
    }
    blur_line(along, weights.data(), reach, columns, result.row(r));
  }
  return result;
}

// Twice as wide and high, blurred to the first scale.
ScaleImage first_scale(const cv::Mat& grey) {
  cv::Mat levels, doubled;
  grey.convertTo(levels, CV_32F);
  cv::resize(levels, doubled, cv::Size(), 2, 2, cv::INTER_LINEAR);
  ScaleImage image(doubled.rows, doubled.cols);
  for (int r = 0; r < doubled.rows; ++r) std::copy_n(doubled.ptr<float>(r), doubled.cols, image.row(r));
  return blurred(image, std::sqrt(kSiftSigma_px * kSiftSigma_px - 4 * kSiftInputBlur_px * kSiftInputBlur_px));
}

ScaleImage every_second(const ScaleImage& image) {
  ScaleImage half(image.rows() / 2, image.columns() / 2);
  for (int r = 0; r < half.rows(); ++r) {
    for (int c = 0; c < half.columns(); ++c) half.row(r)[c] = image.at(2 * r, 2 * c);
  }
  return half;
}

// The scales of an octave: octave_layers + 3, so that octave_layers differences have one on either side.
using Octave = std::vector<ScaleImage>;

std::vector<Octave> scale_space(const cv::Mat& grey, int layers) {
  std::vector<Octave> octaves;
  if (2 * std::min(grey.rows, grey.cols) < kSiftMinOctave_px) return octaves;
  ScaleImage first = first_scale(grey);
  while (std::min(first.rows(), first.columns()) >= kSiftMinOctave_px) {
    Octave octave;
    octave.push_back(std::move(first));
    for (int k = 1; k < layers + 3; ++k) {
      const double before_px = kSiftSigma_px * std::pow(2.0, (k - 1.0) / layers);
      octave.push_back(blurred(octave.back(), before_px * std::sqrt(std::pow(2.0, 2.0 / layers) - 1)));
    }
    first = every_second(octave[index_of(layers)]);
    octaves.push_back(std::move(octave));
  }
  return octaves;
}

// ---- extrema

NADIR_FOR_WIDE_REGISTERS void difference_of(const float* finer, const float* coarser, int count, float* out) {
  for (int c = 0; c < count; ++c) out[c] = coarser[c] - finer[c];
}

struct Extremes {
  explicit Extremes(std::size_t count) : largest(count), smallest(count) {}
  std::vector<float> largest, smallest;
};

NADIR_FOR_WIDE_REGISTERS void largest_of_three(const float* a, const float* b, const float* c, int count,
                                               float* __restrict out) {
  for (int i = 0; i < count; ++i) {
    const float both = a[i] > b[i] ? a[i] : b[i];
    out[i] = both > c[i] ? both : c[i];
  }
}

NADIR_FOR_WIDE_REGISTERS void smallest_of_three(const float* a, const float* b, const float* c, int count,
                                                float* __restrict out) {
  for (int i = 0; i < count; ++i) {
    const float both = a[i] < b[i] ? a[i] : b[i];
    out[i] = both < c[i] ? both : c[i];
  }
}

// 1 where the middle is the largest or smallest of its 3 x 3 x 3 neighbourhood and beyond the sieve. The pixels at both
// ends have no neighbours.
NADIR_FOR_WIDE_REGISTERS int mark_extrema(const float* middle, const float* largest, const float* smallest, float sieve,
                                          int count, std::int32_t* __restrict marks) {
  std::int32_t any = 0;
  for (int c = 1; c < count - 1; ++c) {
    float high = largest[c - 1] > largest[c] ? largest[c - 1] : largest[c];
    high = high > largest[c + 1] ? high : largest[c + 1];
    high = high > sieve ? high : sieve;
    float low = smallest[c - 1] < smallest[c] ? smallest[c - 1] : smallest[c];
    low = low < smallest[c + 1] ? low : smallest[c + 1];
    low = low < -sieve ? low : -sieve;
    const std::int32_t mark =
        static_cast<std::int32_t>(middle[c] >= high) | static_cast<std::int32_t>(middle[c] <= low);
    marks[c] = mark;
    any |= mark;
  }
  return any;
}

struct Keypoint {
  int octave = 0, layer = 0;  // the scale whose gradients describe it
  float x = 0, y = 0;         // pixels of the octave
  float scale_px = 0;         // σ, of the octave's pixels
  float contrast = 0;
};

// The extremum of the quadratic through the neighbours; moves to the neighbour that it lies nearer to. Nothing where
// that does not settle, where the contrast is low, or along an edge: the ratio of principal curvatures, by trace and
// determinant (Lowe 2004, section 4.1).
std::optional<Keypoint> refined_extremum(const Octave& scales, int layer, int r, int c, const SiftOptions& options) {
  const int layers = options.octave_layers, rows = scales[0].rows(), columns = scales[0].columns();
  for (int attempt = 0; attempt < kSiftRefinements; ++attempt) {
    const auto d = [&](int dl, int dr, int dc) {
      return scales[index_of(layer + dl + 1)].at(r + dr, c + dc) - scales[index_of(layer + dl)].at(r + dr, c + dc);
    };
    const float here = d(0, 0, 0);
    // In doubles: Eigen adds three floats in another order on arm64, where it has registers for two.
    const Eigen::Vector3d slope(0.5F * (d(0, 0, 1) - d(0, 0, -1)), 0.5F * (d(0, 1, 0) - d(0, -1, 0)),
                                0.5F * (d(1, 0, 0) - d(-1, 0, 0)));
    const float xx = d(0, 0, 1) + d(0, 0, -1) - 2 * here, yy = d(0, 1, 0) + d(0, -1, 0) - 2 * here,
                ss = d(1, 0, 0) + d(-1, 0, 0) - 2 * here;
    const float xy = 0.25F * (d(0, 1, 1) - d(0, 1, -1) - d(0, -1, 1) + d(0, -1, -1)),
                xs = 0.25F * (d(1, 0, 1) - d(1, 0, -1) - d(-1, 0, 1) + d(-1, 0, -1)),
                ys = 0.25F * (d(1, 1, 0) - d(1, -1, 0) - d(-1, 1, 0) + d(-1, -1, 0));
    Eigen::Matrix3d bend;
    bend << xx, xy, xs, xy, yy, ys, xs, ys, ss;
    const Eigen::Vector3d off = -(bend.inverse() * slope);
    if (!(off.cwiseAbs().maxCoeff() < std::max(rows, columns))) return std::nullopt;  // NaN too
    if (off.cwiseAbs().maxCoeff() < 0.5) {
      const auto contrast = static_cast<float>(std::abs(double{here} + 0.5 * slope.dot(off)));
      if (contrast * static_cast<float>(layers) < 255 * static_cast<float>(options.min_contrast)) return std::nullopt;
      const float trace = xx + yy, determinant = xx * yy - xy * xy;
      constexpr auto kEdge = static_cast<float>(kSiftEdgeRatio);
      if (determinant <= 0 || trace * trace * kEdge >= (kEdge + 1) * (kEdge + 1) * determinant) return std::nullopt;
      Keypoint keypoint;
      keypoint.layer = layer;
      keypoint.x = static_cast<float>(c + off.x());
      keypoint.y = static_cast<float>(r + off.y());
      keypoint.scale_px =
          static_cast<float>(kSiftSigma_px * std::pow(2.0, (layer + off.z()) / static_cast<double>(layers)));
      keypoint.contrast = contrast;
      return keypoint;
    }
    c += static_cast<int>(std::lround(off.x()));
    r += static_cast<int>(std::lround(off.y()));
    layer += static_cast<int>(std::lround(off.z()));
    if (layer < 1 || layer > layers || c < kSiftBorder_px || c >= columns - kSiftBorder_px || r < kSiftBorder_px ||
        r >= rows - kSiftBorder_px) {
      return std::nullopt;
    }
  }
  return std::nullopt;
}

void find_extrema(const Octave& scales, int octave, const SiftOptions& options, std::vector<Keypoint>& keypoints) {
  const int layers = options.octave_layers, rows = scales[0].rows(), columns = scales[0].columns();
  const auto sieve = static_cast<float>(kSiftSieve * 255 * options.min_contrast / layers);
  const std::size_t width = index_of(columns), differences = index_of(layers + 2);
  std::vector<std::vector<float>> ring(3 * differences, std::vector<float>(width));  // three rows of each difference
  std::vector<Extremes> in_scale(differences, Extremes(width));                      // of those three rows
  Extremes all(width);                                                               // of three differences
  std::vector<std::int32_t> marks(width);
  const auto row_of = [&](std::size_t difference, int r) { return ring[3 * difference + index_of(r % 3)].data(); };
  const auto fill = [&](int r) {
    for (std::size_t d = 0; d < differences; ++d) {
      difference_of(scales[d].row(r), scales[d + 1].row(r), columns, row_of(d, r));
    }
  };
  if (std::min(rows, columns) <= 2 * kSiftBorder_px) return;
  fill(kSiftBorder_px - 1);
  fill(kSiftBorder_px);
  for (int r = kSiftBorder_px; r < rows - kSiftBorder_px; ++r) {
    fill(r + 1);
    for (std::size_t d = 0; d < differences; ++d) {
      const float *above = row_of(d, r - 1), *here = row_of(d, r), *below = row_of(d, r + 1);
      largest_of_three(above, here, below, columns, in_scale[d].largest.data());
      smallest_of_three(above, here, below, columns, in_scale[d].smallest.data());
    }
    for (int layer = 1; layer <= layers; ++layer) {
      const std::size_t d = index_of(layer);
      const Extremes &finer = in_scale[d - 1], &same = in_scale[d], &coarser = in_scale[d + 1];
      largest_of_three(finer.largest.data(), same.largest.data(), coarser.largest.data(), columns, all.largest.data());
      smallest_of_three(finer.smallest.data(), same.smallest.data(), coarser.smallest.data(), columns,
                        all.smallest.data());
      if (mark_extrema(row_of(d, r), all.largest.data(), all.smallest.data(), sieve, columns, marks.data()) == 0) {
        continue;
      }
      for (int c = kSiftBorder_px; c < columns - kSiftBorder_px; ++c) {
        if (marks[index_of(c)] == 0) continue;
        if (auto found = refined_extremum(scales, layer, r, c, options)) {
          found->octave = octave;
          keypoints.push_back(*found);
        }
      }
    }
  }
}

// The strongest first; the same point is found from more than one pixel at times.
std::vector<Keypoint> keypoints_of(const std::vector<Octave>& octaves, const SiftOptions& options) {
  std::vector<Keypoint> keypoints;
  for (std::size_t o = 0; o < octaves.size(); ++o) {
    find_extrema(octaves[o], static_cast<int>(o), options, keypoints);
  }
  const auto key = [](const Keypoint& k) { return std::tuple(-k.contrast, k.octave, k.y, k.x, k.scale_px); };
  std::sort(keypoints.begin(), keypoints.end(),
            [&](const Keypoint& one, const Keypoint& other) { return key(one) < key(other); });
  keypoints.erase(std::unique(keypoints.begin(), keypoints.end(),
                              [&](const Keypoint& one, const Keypoint& other) { return key(one) == key(other); }),
                  keypoints.end());
  return keypoints;
}

// ---- gradients around a keypoint

constexpr int kTurnSteps = 256;               // a full turn
constexpr int kCellsAcross = kSiftCells + 2;  // with those beyond the border, which take a part of what lies between
constexpr int kSteps = kTurnSteps / kSiftDirections;

// Angle of a vector in turns, -0.5 to 0.5, counterclockwise from x to y: the arcus tangent of Abramowitz and Stegun
// 4.4.49, good to 1e-5 rad.
[[gnu::always_inline]] inline float turns_of(float x, float y) {
  constexpr auto kPerRadian = static_cast<float>(0.5 / std::numbers::pi);
  const float across = std::abs(x), up = std::abs(y);
  const float larger = across > up ? across : up, smaller = across > up ? up : across;
  const float ratio = smaller / (larger + 1e-9F), squared = ratio * ratio;
  float sum = static_cast<float>(kArcusTangent[4]);
  sum = sum * squared + static_cast<float>(kArcusTangent[3]);
  sum = sum * squared + static_cast<float>(kArcusTangent[2]);
  sum = sum * squared + static_cast<float>(kArcusTangent[1]);
  sum = sum * squared + static_cast<float>(kArcusTangent[0]);
  float turns = sum * ratio * kPerRadian;
  turns = up > across ? 0.25F - turns : turns;
  turns = x < 0 ? 0.5F - turns : turns;
  return y < 0 ? -turns : turns;
}

// The gradients of a piece of a row: towards the right and towards the top.
NADIR_FOR_WIDE_REGISTERS void gradients_of_piece(const float* above, const float* here, const float* below,
                                                 const float* weights, float weight, int count, float* __restrict right,
                                                 float* __restrict up, float* __restrict weighted) {
  for (int i = 0; i < count; ++i) {
    right[i] = here[i + 1] - here[i - 1];
    up[i] = above[i] - below[i];
    weighted[i] = weights[i] * weight;
  }
}

NADIR_FOR_WIDE_REGISTERS void bins_of_piece(float along, float along_step, float across, float across_step, int count,
                                            float* __restrict columns, float* __restrict rows) {
  for (int i = 0; i < count; ++i) {
    columns[i] = along + static_cast<float>(i) * along_step;
    rows[i] = across + static_cast<float>(i) * across_step;
  }
}

// In place: weighted becomes the weighted length. And the angle, `offset` turns added, in steps of which a full turn
// has `steps`.
NADIR_FOR_WIDE_REGISTERS void directions_of(const float* right, const float* up, float* __restrict weighted,
                                            float offset, float steps, int count, std::int32_t* __restrict step) {
  for (int i = 0; i < count; ++i) {
    const float x = right[i], y = up[i];
    weighted[i] *= std::sqrt(x * x + y * y);
    step[i] = static_cast<std::int32_t>((turns_of(x, y) + offset) * steps + 0.5F);
  }
}

// Where a gradient goes: the cell above and to the left, how far it is towards the next ones, and its direction.
NADIR_FOR_WIDE_REGISTERS void cells_of(float* __restrict columns, float* __restrict rows, std::int32_t* __restrict step,
                                       int count, std::int32_t* __restrict cell) {
  constexpr float kLast = kSiftCells + 1 - 1e-3F;
  for (int i = 0; i < count; ++i) {
    const float column = columns[i] > 0 ? columns[i] : 0, row = rows[i] > 0 ? rows[i] : 0;
    const float limited_column = column < kLast ? column : kLast, limited_row = row < kLast ? row : kLast;
    const auto whole_column = static_cast<std::int32_t>(limited_column);
    const auto whole_row = static_cast<std::int32_t>(limited_row);
    columns[i] = limited_column - static_cast<float>(whole_column);
    rows[i] = limited_row - static_cast<float>(whole_row);
    cell[i] = whole_row * kCellsAcross + whole_column;
    step[i] &= kTurnSteps - 1;
  }
}

// A cell's histogram, in one register or two.
struct alignas(kSiftDirections * sizeof(float)) Histogram {
  using Bins [[gnu::vector_size(kSiftDirections * sizeof(float))]] = float;
  Bins bins{};
};
using Histograms = std::array<Histogram, std::size_t{kCellsAcross} * kCellsAcross>;

// Each gradient to the four cells around it, in the eight directions at once. Neighbouring gradients mostly go to the
// same cells: two sets in turn, so that one sum need not wait for the other.
NADIR_FOR_WIDE_REGISTERS void add_gradients(const float* length, const float* columns, const float* rows,
                                            const std::int32_t* cell, const std::int32_t* step,
                                            const Histogram* directions, int count, Histogram* even, Histogram* odd) {
  for (int i = 0; i < count; ++i) {
    const float below = length[i] * rows[i], above = length[i] - below;
    const float below_right = below * columns[i], below_left = below - below_right;
    const float above_right = above * columns[i], above_left = above - above_right;
    const Histogram::Bins share = directions[step[i]].bins;
    Histogram* first = (i % 2 == 0 ? even : odd) + cell[i];
    first[0].bins += above_left * share;
    first[1].bins += above_right * share;
    first[kCellsAcross].bins += below_left * share;
    first[kCellsAcross + 1].bins += below_right * share;
  }
}

// How a direction divides among the eight, for each step of a full turn.
std::vector<Histogram> shares_of_directions() {
  std::vector<Histogram> shares(kTurnSteps);
  for (int i = 0; i < kTurnSteps; ++i) {
    const int first = i / kSteps;
    const float part = static_cast<float>(i % kSteps) / kSteps;
    shares[index_of(i)].bins[first] = 1 - part;
    shares[index_of(i)].bins[(first + 1) % kSiftDirections] = part;
  }
  return shares;
}

// Describes keypoints one after the other; keeps its buffers.
class KeypointDescriber {
 public:
  // Where the smoothed histogram of directions peaks, in turns: the strongest, and those almost as strong.
  const std::vector<float>& directions(const Keypoint& keypoint, const ScaleImage& image) {
    const double sigma_px = kSiftOrientationSigma * static_cast<double>(keypoint.scale_px);
    const int reach = static_cast<int>(std::lround(kSiftOrientationReach * sigma_px));
    begin(reach, sigma_px);
    const int middle_x = static_cast<int>(std::lround(keypoint.x)),
              middle_y = static_cast<int>(std::lround(keypoint.y));
    const int from = std::max(-reach, 1 - middle_x), to = std::min(reach, image.columns() - 2 - middle_x);
    for (int i = -reach; i <= reach; ++i) add_piece(image, middle_x, middle_y, i, from, to);
    directions_of(right_.data(), up_.data(), length_.data(), 1, kSiftOrientationBins, count_, step_.data());

    std::array<float, kSiftOrientationBins> raw{}, smooth{};
    for (std::size_t i = 0; i < index_of(count_); ++i) raw[index_of(step_[i] % kSiftOrientationBins)] += length_[i];
    const auto around = [&raw](int i) { return raw[index_of((i + kSiftOrientationBins) % kSiftOrientationBins)]; };
    for (int i = 0; i < kSiftOrientationBins; ++i) {
      smooth[index_of(i)] = (around(i - 2) + around(i + 2) + 4 * (around(i - 1) + around(i + 1)) + 6 * around(i)) / 16;
    }
    const float least = static_cast<float>(kSiftSecondPeak) * *std::max_element(smooth.begin(), smooth.end());
    found_.clear();
    for (int i = 0; i < kSiftOrientationBins; ++i) {
      const float here = smooth[index_of(i)];
      const float before = smooth[index_of((i + kSiftOrientationBins - 1) % kSiftOrientationBins)];
      const float after = smooth[index_of((i + 1) % kSiftOrientationBins)];
      if (!(here > before && here > after && here >= least)) continue;
      const float off = 0.5F * (before - after) / (before - 2 * here + after);
      found_.push_back((static_cast<float>(i) + off) / kSiftOrientationBins);
    }
    return found_;
  }

  void describe(const Keypoint& keypoint, float turns, const ScaleImage& image,
                std::array<std::int16_t, FeatureDescriptors::kLength>& descriptor) {
    const double cell_px = kSiftCellWidth * static_cast<double>(keypoint.scale_px);
    const double half_px = (kSiftCells + 1) * cell_px / 2;  // as far as the outer cells take a part
    const int reach = static_cast<int>(std::lround(half_px * std::numbers::sqrt2));
    begin(reach, cell_px * kSiftCells / 2);
    const double angle = 2 * std::numbers::pi * static_cast<double>(turns);
    const double cosine = std::cos(angle), sine = std::sin(angle);
    const int middle_x = static_cast<int>(std::lround(keypoint.x)),
              middle_y = static_cast<int>(std::lround(keypoint.y));
    for (int i = -reach; i <= reach; ++i) {
      // In the turned square: |j cos - i sin| and |j sin + i cos| are below half_px.
      double from = std::max(-reach, 1 - middle_x), to = std::min(reach, image.columns() - 2 - middle_x);
      const auto limit = [&](double factor, double offset) {
        if (std::abs(factor) < 1e-6) {
          if (std::abs(offset) >= half_px) to = from - 1;
          return;
        }
        const double one = (-offset - half_px) / factor, other = (-offset + half_px) / factor;
        from = std::max(from, std::min(one, other));
        to = std::min(to, std::max(one, other));
      };
      limit(cosine, -i * sine);
      limit(sine, i * cosine);
      const int first = static_cast<int>(std::ceil(from)), last = static_cast<int>(std::floor(to));
      const int begin = count_;
      add_piece(image, middle_x, middle_y, i, first, last);
      // The first of the outer cells' middles is 0.
      constexpr double kMiddle = (kSiftCells + 1) / 2.0;
      bins_of_piece(static_cast<float>((first * cosine - i * sine) / cell_px + kMiddle),
                    static_cast<float>(cosine / cell_px),
                    static_cast<float>((first * sine + i * cosine) / cell_px + kMiddle),
                    static_cast<float>(sine / cell_px), count_ - begin, columns_.data() + begin, rows_.data() + begin);
    }
    directions_of(right_.data(), up_.data(), length_.data(), 2 - turns, kTurnSteps, count_, step_.data());
    cells_of(columns_.data(), rows_.data(), step_.data(), count_, cell_.data());
    Histograms even{}, odd{};
    add_gradients(length_.data(), columns_.data(), rows_.data(), cell_.data(), step_.data(), shares_.data(), count_,
                  even.data(), odd.data());
    std::array<float, FeatureDescriptors::kLength> values;
    auto value = values.begin();
    for (int row = 1; row <= kSiftCells; ++row) {
      for (int column = 1; column <= kSiftCells; ++column) {
        const std::size_t at = index_of(row * kCellsAcross + column);
        const Histogram::Bins sum = even[at].bins + odd[at].bins;
        for (int k = 0; k < kSiftDirections; ++k) *value++ = sum[k];
      }
    }
    // No single edge may outweigh the rest, and contrast does not count.
    const float limit = static_cast<float>(kSiftLargest) * length_of(values);
    for (float& one : values) one = std::min(one, limit);
    const float factor = static_cast<float>(kSiftLength) / std::max(length_of(values), 1e-9F);
    std::transform(values.begin(), values.end(), descriptor.begin(),
                   [factor](float one) { return static_cast<std::int16_t>(std::min(one * factor + 0.5F, 255.0F)); });
  }

 private:
  void begin(int reach, double sigma_px) {
    const std::size_t side = index_of(2 * reach + 1), most = side * side;
    if (right_.size() < most) {
      for (std::vector<float>* values : {&right_, &up_, &length_, &columns_, &rows_}) values->resize(most);
      for (std::vector<std::int32_t>* values : {&step_, &cell_}) values->resize(most);
    }
    weights_.resize(side);
    for (int i = 0; i <= reach; ++i) {
      const auto weight = static_cast<float>(std::exp(-0.5 * i * i / (sigma_px * sigma_px)));
      weights_[index_of(reach + i)] = weights_[index_of(reach - i)] = weight;
    }
    reach_ = reach;
    count_ = 0;
  }

  // The gradients i rows below the middle, from `first` to `last` pixels to its right.
  void add_piece(const ScaleImage& image, int middle_x, int middle_y, int i, int first, int last) {
    const int r = middle_y + i;
    if (r < 1 || r >= image.rows() - 1 || first > last) return;
    const int at = middle_x + first, count = last - first + 1;
    gradients_of_piece(image.row(r - 1) + at, image.row(r) + at, image.row(r + 1) + at,
                       weights_.data() + reach_ + first, weights_[index_of(reach_ + i)], count, right_.data() + count_,
                       up_.data() + count_, length_.data() + count_);
    count_ += count;
  }

  static float length_of(const std::array<float, FeatureDescriptors::kLength>& values) {
    std::array<float, kSiftDirections> sums{};
    for (std::size_t i = 0; i < values.size(); ++i) sums[i % sums.size()] += values[i] * values[i];
    return std::sqrt(std::accumulate(sums.begin(), sums.end(), 0.0F));
  }

  std::vector<Histogram> shares_ = shares_of_directions();
  std::vector<float> weights_;  // of a Gaussian, from -reach to reach
  int reach_ = 0, count_ = 0;
  std::vector<float> right_, up_, length_, columns_, rows_;
  std::vector<std::int32_t> step_, cell_;
  std::vector<float> found_;
};

}  // namespace

SiftFeatures sift_features(const cv::Mat& grey, const SiftOptions& options) {
  SiftFeatures features;
  const std::vector<Octave> octaves = scale_space(grey, options.octave_layers);
  KeypointDescriber describer;
  std::array<std::int16_t, FeatureDescriptors::kLength> descriptor;
  for (const Keypoint& keypoint : keypoints_of(octaves, options)) {
    if (features.points.size() >= index_of(options.max_features)) break;
    const ScaleImage& image = octaves[index_of(keypoint.octave)][index_of(keypoint.layer)];
    const auto size = static_cast<float>(1 << keypoint.octave);  // of a pixel, in those of the doubled image
    for (const float turns : describer.directions(keypoint, image)) {
      describer.describe(keypoint, turns, image, descriptor);
      features.descriptors.add(descriptor);
      features.points.emplace_back((keypoint.x * size + 0.5F) / 2 - 0.5F, (keypoint.y * size + 0.5F) / 2 - 0.5F);
    }
  }
  return features;
}

}  // namespace nadir
