#include "vision/fourier.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>

#include "base/platform.hpp"

namespace nadir {
namespace {

constexpr std::size_t kBlock = FourierSteps::kColumns;

struct Lines {
  float *real, *imaginary;
};

// y[R p + j] = w^(p j) Σ_k x[p + m k] exp(-2πi j k / R), for each part p of m, over `width` numbers side by side.
NADIR_FOR_WIDE_REGISTERS void radix_4(const float* turns, std::size_t parts, std::size_t width, const float* xr,
                                      const float* xi, float* yr, float* yi) {
  const std::size_t quarter = parts * width;
  for (std::size_t p = 0; p < parts; ++p, turns += 6) {
    const float w1r = turns[0], w1i = turns[1], w2r = turns[2], w2i = turns[3], w3r = turns[4], w3i = turns[5];
    const float *ar = xr + p * width, *ai = xi + p * width;
    const float *br = ar + quarter, *bi = ai + quarter;
    const float *cr = ar + 2 * quarter, *ci = ai + 2 * quarter;
    const float *dr = ar + 3 * quarter, *di = ai + 3 * quarter;
    float *out0r = yr + 4 * p * width, *out0i = yi + 4 * p * width;
    float *out1r = out0r + width, *out1i = out0i + width;
    float *out2r = out0r + 2 * width, *out2i = out0i + 2 * width;
    float *out3r = out0r + 3 * width, *out3i = out0i + 3 * width;
#pragma GCC ivdep
    for (std::size_t q = 0; q < width; ++q) {
      const float sumr = ar[q] + cr[q], sumi = ai[q] + ci[q];
      const float difr = ar[q] - cr[q], difi = ai[q] - ci[q];
      const float osumr = br[q] + dr[q], osumi = bi[q] + di[q];
      const float odifr = br[q] - dr[q], odifi = bi[q] - di[q];
      out0r[q] = sumr + osumr;
      out0i[q] = sumi + osumi;
      const float oner = difr + odifi, onei = difi - odifr;
      out1r[q] = w1r * oner - w1i * onei;
      out1i[q] = w1r * onei + w1i * oner;
      const float twor = sumr - osumr, twoi = sumi - osumi;
      out2r[q] = w2r * twor - w2i * twoi;
      out2i[q] = w2r * twoi + w2i * twor;
      const float threer = difr - odifi, threei = difi + odifr;
      out3r[q] = w3r * threer - w3i * threei;
      out3i[q] = w3r * threei + w3i * threer;
    }
  }
}

NADIR_FOR_WIDE_REGISTERS void radix_3(const float* turns, std::size_t parts, std::size_t width, const float* xr,
                                      const float* xi, float* yr, float* yi) {
  const std::size_t third = parts * width;
  constexpr float kHalfRootOf3 = static_cast<float>(std::numbers::sqrt3 / 2);
  for (std::size_t p = 0; p < parts; ++p, turns += 6) {
    const float w1r = turns[0], w1i = turns[1], w2r = turns[2], w2i = turns[3];
    const float *ar = xr + p * width, *ai = xi + p * width;
    const float *br = ar + third, *bi = ai + third;
    const float *cr = ar + 2 * third, *ci = ai + 2 * third;
    float *out0r = yr + 3 * p * width, *out0i = yi + 3 * p * width;
    float *out1r = out0r + width, *out1i = out0i + width;
    float *out2r = out0r + 2 * width, *out2i = out0i + 2 * width;
#pragma GCC ivdep
    for (std::size_t q = 0; q < width; ++q) {
      const float sumr = br[q] + cr[q], sumi = bi[q] + ci[q];
      const float difr = kHalfRootOf3 * (br[q] - cr[q]);
      const float difi = kHalfRootOf3 * (bi[q] - ci[q]);
      const float midr = ar[q] - 0.5F * sumr, midi = ai[q] - 0.5F * sumi;
      out0r[q] = ar[q] + sumr;
      out0i[q] = ai[q] + sumi;
      const float oner = midr + difi, onei = midi - difr;
      out1r[q] = w1r * oner - w1i * onei;
      out1i[q] = w1r * onei + w1i * oner;
      const float twor = midr - difi, twoi = midi + difr;
      out2r[q] = w2r * twor - w2i * twoi;
      out2i[q] = w2r * twoi + w2i * twor;
    }
  }
}

NADIR_FOR_WIDE_REGISTERS void radix_2(const float* turns, std::size_t parts, std::size_t width, const float* xr,
                                      const float* xi, float* yr, float* yi) {
  const std::size_t half = parts * width;
  for (std::size_t p = 0; p < parts; ++p, turns += 6) {
    const float w1r = turns[0], w1i = turns[1];
    const float *ar = xr + p * width, *ai = xi + p * width;
    const float *br = ar + half, *bi = ai + half;
    float *out0r = yr + 2 * p * width, *out0i = yi + 2 * p * width;
    float *out1r = out0r + width, *out1i = out0i + width;
#pragma GCC ivdep
    for (std::size_t q = 0; q < width; ++q) {
      const float difr = ar[q] - br[q], difi = ai[q] - bi[q];
      out0r[q] = ar[q] + br[q];
      out0i[q] = ai[q] + bi[q];
      out1r[q] = w1r * difr - w1i * difi;
      out1i[q] = w1r * difi + w1i * difr;
    }
  }
}

// Blocks of columns in memory that the steps swap between.
class Scratch {
 public:
  explicit Scratch(std::size_t length)
      : values_(std::make_unique_for_overwrite<float[]>(4 * length * kBlock)), size_(length * kBlock) {}
  Lines one() { return {values_.get(), values_.get() + size_}; }
  Lines other() { return {values_.get() + 2 * size_, values_.get() + 3 * size_}; }
  // Transforms what lies in one() and returns where the result is.
  Lines transform(const FourierSteps& steps) {
    const bool swapped = steps.transform(one().real, one().imaginary, other().real, other().imaginary);
    return swapped ? other() : one();
  }

 private:
  std::unique_ptr<float[]> values_;
  std::size_t size_;
};

// A block of sixteen columns, and of an image's rows that many wide pieces.
void copy_piece(const float* from, std::size_t width, float* to) {
  if (width == kBlock) {
    std::memcpy(to, from, kBlock * sizeof(float));  // of a known size: no call
  } else {
    std::copy_n(from, width, to);
  }
}

void load_columns(const float* from, std::size_t stride, std::size_t rows, std::size_t width, std::size_t length,
                  float* block) {
  for (std::size_t r = 0; r < rows; ++r) {
    float* row = block + r * kBlock;
    copy_piece(from + r * stride, width, row);
    std::fill(row + width, row + kBlock, 0.0F);
  }
  std::fill(block + rows * kBlock, block + length * kBlock, 0.0F);
}

void store_columns(const float* block, std::size_t rows, std::size_t width, std::size_t stride, float* to) {
  for (std::size_t r = 0; r < rows; ++r) copy_piece(block + r * kBlock, width, to + r * stride);
}

using FourFloats [[gnu::vector_size(16), gnu::aligned(4), gnu::may_alias]] = float;
using FourIndices [[gnu::vector_size(16)]] = int;

// Four rows of four numbers each become four columns.
void transpose_4(const float* from, std::size_t stride, float* to, std::size_t to_stride) {
  const auto row = [&](std::size_t r) { return *reinterpret_cast<const FourFloats*>(from + r * stride); };
  const FourFloats a = row(0), b = row(1), c = row(2), d = row(3);
  const FourFloats ab = __builtin_shuffle(a, b, FourIndices{0, 4, 1, 5}),
                   ab2 = __builtin_shuffle(a, b, FourIndices{2, 6, 3, 7});
  const FourFloats cd = __builtin_shuffle(c, d, FourIndices{0, 4, 1, 5}),
                   cd2 = __builtin_shuffle(c, d, FourIndices{2, 6, 3, 7});
  const auto store = [&](std::size_t r, FourFloats value) {
    *reinterpret_cast<FourFloats*>(to + r * to_stride) = value;
  };
  store(0, __builtin_shuffle(ab, cd, FourIndices{0, 1, 4, 5}));
  store(1, __builtin_shuffle(ab, cd, FourIndices{2, 3, 6, 7}));
  store(2, __builtin_shuffle(ab2, cd2, FourIndices{0, 1, 4, 5}));
  store(3, __builtin_shuffle(ab2, cd2, FourIndices{2, 3, 6, 7}));
}

// Rows and columns: multiples of four.
void transpose(const float* from, std::size_t rows, std::size_t columns, std::size_t stride, float* to,
               std::size_t to_stride) {
  for (std::size_t r = 0; r < rows; r += 4) {
    for (std::size_t c = 0; c < columns; c += 4) {
      transpose_4(from + r * stride + c, stride, to + c * to_stride + r, to_stride);
    }
  }
}

}  // namespace

ComplexImage::ComplexImage(std::size_t rows, std::size_t columns)
    : rows_(rows), columns_(columns), values_(std::make_unique_for_overwrite<float[]>(2 * rows * columns)) {}

void ComplexImage::clear() { std::fill_n(values_.get(), 2 * rows_ * columns_, 0.0F); }

FourierSteps::FourierSteps(std::size_t length) : length_(length) {
  std::size_t left = length, apart = 1;
  while (left > 1) {
    Step step;
    step.radix = left % 3 == 0 ? 3 : left % 4 == 0 ? 4 : 2;
    step.parts = left / step.radix;
    step.apart = apart;
    for (std::size_t p = 0; p < step.parts; ++p) {
      for (std::size_t power = 1; power <= 3; ++power) {
        const double angle = -2 * std::numbers::pi * static_cast<double>(p * power) / static_cast<double>(left);
        step.turns.push_back(static_cast<float>(std::cos(angle)));
        step.turns.push_back(static_cast<float>(std::sin(angle)));
      }
    }
    left = step.parts;
    apart *= step.radix;
    steps_.push_back(std::move(step));
  }
}

bool FourierSteps::transform(float* real, float* imaginary, float* other_real, float* other_imaginary) const {
  bool swapped = false;
  for (const Step& step : steps_) {
    const auto run = step.radix == 4 ? radix_4 : step.radix == 3 ? radix_3 : radix_2;
    run(step.turns.data(), step.parts, step.apart * kColumns, real, imaginary, other_real, other_imaginary);
    std::swap(real, other_real);
    std::swap(imaginary, other_imaginary);
    swapped = !swapped;
  }
  return swapped;
}

FourierTransform::FourierTransform(std::size_t rows, std::size_t columns)
    : along_rows_(rows), along_columns_(columns) {}

ComplexImage FourierTransform::forward(const ComplexImage& image) const {
  ComplexImage spectrum(columns(), rows());
  Scratch vertical(rows());
  const std::size_t used = std::min(columns(), (image.columns() + kBlock - 1) / kBlock * kBlock);
  for (std::size_t c = 0; c < used; c += kBlock) {
    const std::size_t width = std::min(kBlock, image.columns() - c);
    load_columns(image.real(0) + c, image.columns(), image.rows(), width, rows(), vertical.one().real);
    load_columns(image.imaginary(0) + c, image.columns(), image.rows(), width, rows(), vertical.one().imaginary);
    const Lines result = vertical.transform(along_rows_);
    transpose(result.real, rows(), kBlock, kBlock, spectrum.real(c), rows());
    transpose(result.imaginary, rows(), kBlock, kBlock, spectrum.imaginary(c), rows());
  }
  Scratch horizontal(columns());
  for (std::size_t r = 0; r < rows(); r += kBlock) {
    load_columns(spectrum.real(0) + r, rows(), used, kBlock, columns(), horizontal.one().real);
    load_columns(spectrum.imaginary(0) + r, rows(), used, kBlock, columns(), horizontal.one().imaginary);
    const Lines result = horizontal.transform(along_columns_);
    store_columns(result.real, columns(), kBlock, rows(), spectrum.real(0) + r);
    store_columns(result.imaginary, columns(), kBlock, rows(), spectrum.imaginary(0) + r);
  }
  return spectrum;
}

// The inverse of a transform is the transform with both parts swapped before and after.
ComplexImage FourierTransform::inverse(ComplexImage& spectrum, std::size_t out_rows, std::size_t out_columns) const {
  Scratch horizontal(columns());
  for (std::size_t r = 0; r < rows(); r += kBlock) {
    load_columns(spectrum.real(0) + r, rows(), columns(), kBlock, columns(), horizontal.one().imaginary);
    load_columns(spectrum.imaginary(0) + r, rows(), columns(), kBlock, columns(), horizontal.one().real);
    const Lines result = horizontal.transform(along_columns_);
    store_columns(result.imaginary, out_columns, kBlock, rows(), spectrum.real(0) + r);
    store_columns(result.real, out_columns, kBlock, rows(), spectrum.imaginary(0) + r);
  }
  ComplexImage image(out_rows, out_columns);
  Scratch vertical(rows());
  for (std::size_t c = 0; c < out_columns; c += kBlock) {
    const std::size_t width = std::min(kBlock, out_columns - c);
    // Rows beyond those that are asked for hold other numbers, which are not stored.
    transpose(spectrum.real(c), kBlock, rows(), rows(), vertical.one().imaginary, kBlock);
    transpose(spectrum.imaginary(c), kBlock, rows(), rows(), vertical.one().real, kBlock);
    const Lines result = vertical.transform(along_rows_);
    store_columns(result.imaginary, out_rows, width, out_columns, image.real(0) + c);
    store_columns(result.real, out_rows, width, out_columns, image.imaginary(0) + c);
  }
  return image;
}

std::size_t FourierTransform::fitting_length(std::size_t least) {
  std::size_t length = kBlock;
  while (length < least) length *= 2;
  const std::size_t with_three = length / 4 * 3;
  return with_three >= least && with_three % kBlock == 0 ? with_three : length;
}

}  // namespace nadir
