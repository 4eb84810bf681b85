#include "vision/feature_descriptors.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "base/platform.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {
namespace {

constexpr std::size_t kSamples = std::size_t{kDescriptorPositions} * kDescriptorPositions;
constexpr std::size_t kLength = std::size_t{kDescriptorCells} * kDescriptorCells * kDescriptorTurns;

// Gradients of one level, both of a pixel side by side.
struct Level {
  cv::Mat gradient;  // CV_32FC2
  double pixel = 1;  // in pixels of the image
};

cv::Mat gradient_of(const cv::Mat& image) {
  cv::Mat gradient(image.size(), CV_32FC2, cv::Scalar::all(0));
  for (int r = 1; r + 1 < image.rows; ++r) {
    const auto *above = image.ptr<float>(r - 1), *here = image.ptr<float>(r), *below = image.ptr<float>(r + 1);
    auto* out = gradient.ptr<float>(r);
    for (int c = 1; c + 1 < image.cols; ++c) {
      out[2 * c] = here[c + 1] - here[c - 1];
      out[2 * c + 1] = below[c] - above[c];
    }
  }
  return gradient;
}

std::vector<Level> levels_of(const cv::Mat& grey) {
  std::vector<Level> levels;
  cv::Mat image;
  grey.convertTo(image, CV_32F);
  double sigma = kDescriptorCameraSigma_px, pixel = 1;
  for (int octave = 0; octave < kDescriptorOctaves; ++octave) {
    for (int level = 1; level <= kDescriptorLevels; ++level) {
      const double wanted = kDescriptorFirstSigma_px * std::exp2(static_cast<double>(level) / kDescriptorLevels);
      const double more = std::sqrt(wanted * wanted - sigma * sigma);
      cv::Mat smooth;
      cv::GaussianBlur(image, smooth, cv::Size(), more, more, cv::BORDER_REFLECT_101);
      image = smooth;
      sigma = wanted;
      levels.push_back({gradient_of(image), pixel});
    }
    if (std::min(image.rows, image.cols) < 2 * kDescriptorPositions) break;
    cv::Mat half((image.rows + 1) / 2, (image.cols + 1) / 2, CV_32FC1);
    for (int r = 0; r < half.rows; ++r) {
      const auto* from = image.ptr<float>(2 * r);
      auto* to = half.ptr<float>(r);
      for (int c = 0; c < half.cols; ++c) to[c] = from[2 * c];
    }
    image = half;
    sigma /= 2;
    pixel *= 2;
  }
  return levels;
}

// What all descriptors share: where the positions lie, in cells, and what they add to which cells.
struct Pattern {
  std::array<float, kSamples> x{}, y{}, weight{};
  // The first of two cells along each side that a position adds to, and its share of the second; -1 and
  // kDescriptorCells - 1 have one cell only.
  std::array<int, kDescriptorPositions> cell{};
  std::array<float, kDescriptorPositions> share{};

  Pattern() {
    const auto at = [](int i) { return kDescriptorReach * ((2 * i + 1.0) / kDescriptorPositions - 1); };
    for (int i = 0; i < kDescriptorPositions; ++i) {
      const double in_cells = at(i) + kDescriptorCells / 2.0 - 0.5;
      cell[static_cast<std::size_t>(i)] = static_cast<int>(std::floor(in_cells));
      share[static_cast<std::size_t>(i)] = static_cast<float>(in_cells - std::floor(in_cells));
      for (int j = 0; j < kDescriptorPositions; ++j) {
        const auto k = static_cast<std::size_t>(i * kDescriptorPositions + j);
        x[k] = static_cast<float>(at(j));
        y[k] = static_cast<float>(at(i));
        weight[k] = static_cast<float>(
            std::exp(-(at(i) * at(i) + at(j) * at(j)) / (kDescriptorCells * kDescriptorCells / 2.0)));
      }
    }
  }
};

struct Samples {
  std::array<float, kSamples> x, y;            // gradients in the feature's frame
  std::array<float, kSamples> strength, turn;  // turn: 0 to kDescriptorTurns
};

// The angle by a quotient of polynomials (Padé), good to 0.001 rad: the same on every processor.
NADIR_FOR_WIDE_REGISTERS void measure(const Pattern& pattern, Samples& samples) {
  constexpr float kEighthsPerRad = static_cast<float>(4 * std::numbers::inv_pi);
  constexpr float kTurnsPerEighth = static_cast<float>(kDescriptorTurns) / 8;
  for (std::size_t k = 0; k < kSamples; ++k) {
    const float x = samples.x[k], y = samples.y[k];
    const float ax = std::abs(x), ay = std::abs(y);
    const float low = ax < ay ? ax : ay, high = ax < ay ? ay : ax;
    const float q = low / (high + std::numeric_limits<float>::min()), q2 = q * q;
    const float eighths = kEighthsPerRad * q * (105 + 55 * q2) / (105 + 90 * q2 + 9 * q2 * q2);
    const float quarter = ax < ay ? 2 - eighths : eighths;
    const float half = x < 0 ? 4 - quarter : quarter;
    const float whole = y < 0 ? 8 - half : half;
    samples.turn[k] = whole * kTurnsPerEighth;
    samples.strength[k] = std::sqrt(x * x + y * y) * pattern.weight[k];
  }
}

void read_samples(const Level& level, const cv::KeyPoint& feature, const Pattern& pattern, Samples& samples) {
  const double angle = static_cast<double>(feature.angle) * std::numbers::pi / 180;
  const auto cosine = static_cast<float>(std::cos(angle)), sine = static_cast<float>(std::sin(angle));
  const auto cell = static_cast<float>(kDescriptorCellSigmas * static_cast<double>(feature.size) / 2 / level.pixel);
  const auto pixel = static_cast<float>(level.pixel);
  const float middle_x = feature.pt.x / pixel, middle_y = feature.pt.y / pixel;
  const auto right = static_cast<float>(level.gradient.cols - 2), bottom = static_cast<float>(level.gradient.rows - 2);
  const float along_x = cosine * cell, along_y = sine * cell;
  for (std::size_t k = 0; k < kSamples; ++k) {
    const float x = middle_x + pattern.x[k] * along_x - pattern.y[k] * along_y;
    const float y = middle_y + pattern.x[k] * along_y + pattern.y[k] * along_x;
    if (!(x >= 0 && y >= 0 && x <= right && y <= bottom)) {
      samples.x[k] = samples.y[k] = 0;
      continue;
    }
    const int column = static_cast<int>(x), row = static_cast<int>(y);
    const float u = x - static_cast<float>(column), v = y - static_cast<float>(row);
    const auto *above = level.gradient.ptr<float>(row) + 2 * column,
               *below = level.gradient.ptr<float>(row + 1) + 2 * column;
    const float a = (1 - u) * (1 - v), b = u * (1 - v), c = (1 - u) * v, d = u * v;
    const float gx = a * above[0] + b * above[2] + c * below[0] + d * below[2];
    const float gy = a * above[1] + b * above[3] + c * below[1] + d * below[3];
    samples.x[k] = cosine * gx + sine * gy;
    samples.y[k] = cosine * gy - sine * gx;
  }
}

void add_up(const Pattern& pattern, const Samples& samples, float* descriptor) {
  // With a margin of one cell around, and of one turn at the end.
  constexpr std::size_t kRow = std::size_t{kDescriptorTurns} + 2, kSide = std::size_t{kDescriptorCells} + 2;
  std::array<float, kSide * kSide * kRow> cells{};
  for (std::size_t i = 0; i < kDescriptorPositions; ++i) {
    const float down = pattern.share[i];
    float* cell_row = cells.data() + static_cast<std::size_t>(pattern.cell[i] + 1) * kSide * kRow;
    for (std::size_t j = 0; j < kDescriptorPositions; ++j) {
      const std::size_t k = i * kDescriptorPositions + j;
      const auto turn = static_cast<std::size_t>(samples.turn[k]);
      const float next = samples.strength[k] * (samples.turn[k] - static_cast<float>(turn));
      const float first = samples.strength[k] - next;
      const float across = pattern.share[j];
      float* cell = cell_row + static_cast<std::size_t>(pattern.cell[j] + 1) * kRow + turn;
      const float upper_left = (1 - down) * (1 - across), upper_right = (1 - down) * across;
      const float lower_left = down * (1 - across), lower_right = down * across;
      cell[0] += upper_left * first;
      cell[1] += upper_left * next;
      cell[kRow] += upper_right * first;
      cell[kRow + 1] += upper_right * next;
      cell[kSide * kRow] += lower_left * first;
      cell[kSide * kRow + 1] += lower_left * next;
      cell[kSide * kRow + kRow] += lower_right * first;
      cell[kSide * kRow + kRow + 1] += lower_right * next;
    }
  }
  for (std::size_t r = 0; r < kDescriptorCells; ++r) {
    for (std::size_t c = 0; c < kDescriptorCells; ++c) {
      const float* cell = cells.data() + ((r + 1) * kSide + c + 1) * kRow;
      float* out = descriptor + (r * kDescriptorCells + c) * kDescriptorTurns;
      std::copy_n(cell, kDescriptorTurns, out);
      out[0] += cell[kDescriptorTurns];  // a whole turn is none
      out[1] += cell[kDescriptorTurns + 1];
    }
  }
}

void normalise(float* descriptor) {
  const auto length = [&] {
    float squares = 0;
    for (std::size_t k = 0; k < kLength; ++k) squares += descriptor[k] * descriptor[k];
    return std::sqrt(squares);
  };
  const float largest = kDescriptorLargestShare * length();
  for (std::size_t k = 0; k < kLength; ++k) descriptor[k] = std::min(descriptor[k], largest);
  const float factor = kDescriptorSteps / std::max(length(), 1e-6F);
  for (std::size_t k = 0; k < kLength; ++k) descriptor[k] = std::min(255.0F, std::round(descriptor[k] * factor));
}

}  // namespace

cv::Mat describe_features(const cv::Mat& grey, const std::vector<cv::KeyPoint>& features) {
  cv::Mat descriptors(static_cast<int>(features.size()), static_cast<int>(kLength), CV_32FC1);
  if (features.empty()) return descriptors;
  static const Pattern pattern;
  const std::vector<Level> levels = levels_of(grey);
  Samples samples;
  for (std::size_t i = 0; i < features.size(); ++i) {
    const double sigma = std::max(kDescriptorFirstSigma_px, static_cast<double>(features[i].size) / 2);
    const auto level = std::lround(kDescriptorLevels * std::log2(sigma / kDescriptorFirstSigma_px)) - 1;
    const auto number = static_cast<std::size_t>(std::clamp<long>(level, 0, static_cast<long>(levels.size()) - 1));
    read_samples(levels[number], features[i], pattern, samples);
    measure(pattern, samples);
    auto* descriptor = descriptors.ptr<float>(static_cast<int>(i));
    add_up(pattern, samples, descriptor);
    normalise(descriptor);
  }
  return descriptors;
}

}  // namespace nadir
