#include "imagery/fourier.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>

#include "base/platform.hpp"

namespace nadir {
namespace {

constexpr std::size_t kBlock = FourierSteps::kLines;
// A place in sixteen lines: the real parts of its numbers, then the imaginary ones.
constexpr std::size_t kPlace = 2 * kBlock;

struct Number {
  float real, imaginary;
};
Number operator+(Number a, Number b) { return {a.real + b.real, a.imaginary + b.imaginary}; }
Number operator-(Number a, Number b) { return {a.real - b.real, a.imaginary - b.imaginary}; }
Number operator*(float f, Number a) { return {f * a.real, f * a.imaginary}; }
Number operator*(Number a, Number b) {
  return {a.real * b.real - a.imaginary * b.imaginary, a.real * b.imaginary + a.imaginary * b.real};
}
Number times_i(Number a) { return {-a.imaginary, a.real}; }
Number times_minus_i(Number a) { return {a.imaginary, -a.real}; }

template <std::size_t kRadix>
using Numbers = std::array<Number, kRadix>;

[[gnu::always_inline]] inline Numbers<3> sums(const Numbers<3>& x) {
  constexpr auto kHalfRootOf3 = static_cast<float>(std::numbers::sqrt3 / 2);
  const Number sum = x[1] + x[2], side = kHalfRootOf3 * times_i(x[1] - x[2]), middle = x[0] - 0.5F * sum;
  return {x[0] + sum, middle - side, middle + side};
}

[[gnu::always_inline]] inline void four_sums(Number x0, Number x1, Number x2, Number x3, Number& y0, Number& y1,
                                             Number& y2, Number& y3) {
  const Number even = x0 + x2, even_difference = x0 - x2, odd = x1 + x3, odd_difference = times_i(x1 - x3);
  y0 = even + odd;
  y1 = even_difference - odd_difference;
  y2 = even - odd;
  y3 = even_difference + odd_difference;
}

[[gnu::always_inline]] inline Numbers<4> sums(const Numbers<4>& x) {
  Numbers<4> y;
  four_sums(x[0], x[1], x[2], x[3], y[0], y[1], y[2], y[3]);
  return y;
}

[[gnu::always_inline]] inline Numbers<5> sums(const Numbers<5>& x) {
  constexpr auto kCos1 = static_cast<float>((std::numbers::phi - 1) / 2),
                 kCos2 = static_cast<float>(-std::numbers::phi / 2);
  static const auto kSin1 = static_cast<float>(std::sin(2 * std::numbers::pi / 5)),
                    kSin2 = static_cast<float>(std::sin(4 * std::numbers::pi / 5));
  const Number sum14 = x[1] + x[4], difference14 = x[1] - x[4], sum23 = x[2] + x[3], difference23 = x[2] - x[3];
  const Number middle1 = x[0] + (kCos1 * sum14 + kCos2 * sum23), middle2 = x[0] + (kCos2 * sum14 + kCos1 * sum23);
  const Number side1 = times_i(kSin1 * difference14 + kSin2 * difference23);
  const Number side2 = times_i(kSin2 * difference14 - kSin1 * difference23);
  return {x[0] + (sum14 + sum23), middle1 - side1, middle2 - side2, middle2 + side2, middle1 + side1};
}

[[gnu::always_inline]] inline Numbers<8> sums(const Numbers<8>& x) {
  constexpr auto kHalfRootOf2 = static_cast<float>(std::numbers::sqrt2 / 2);
  Numbers<8> y;
  four_sums(x[0] + x[4], x[1] + x[5], x[2] + x[6], x[3] + x[7], y[0], y[2], y[4], y[6]);
  // exp(-2πi k / 8): 1, (1 - i) / √2, -i and (-1 - i) / √2.
  const Number d1 = x[1] - x[5], d3 = x[3] - x[7];
  four_sums(x[0] - x[4], kHalfRootOf2 * (d1 - times_i(d1)), times_minus_i(x[2] - x[6]),
            kHalfRootOf2 * (times_minus_i(d3) - d3), y[1], y[3], y[5], y[7]);
  return y;
}

// y[R p + j] = w^(p j) Σ_k x[p + m k] exp(-2πi j k / R) for each part p of m, over `apart` places side by side.
template <std::size_t kRadix>
[[gnu::always_inline]] inline void all_parts(const float* turns, std::size_t parts, std::size_t apart, const float* x,
                                             float* y) {
  const std::size_t from = parts * apart * kPlace, to = apart * kPlace;
  for (std::size_t p = 0; p < parts; ++p, turns += 2 * kRadix, y += (kRadix - 1) * to) {
    Numbers<kRadix> w;
    for (std::size_t j = 0; j < kRadix; ++j) w[j] = {turns[2 * j], turns[2 * j + 1]};
    for (std::size_t s = 0; s < apart; ++s, x += kPlace, y += kPlace) {
#pragma GCC ivdep
      for (std::size_t q = 0; q < kBlock; ++q) {
        Numbers<kRadix> in;
#pragma GCC unroll 8
        for (std::size_t k = 0; k < kRadix; ++k) in[k] = {x[k * from + q], x[k * from + kBlock + q]};
        const Numbers<kRadix> out = sums(in);
        y[q] = out[0].real;
        y[kBlock + q] = out[0].imaginary;
#pragma GCC unroll 8
        for (std::size_t j = 1; j < kRadix; ++j) {
          const Number turned = w[j] * out[j];
          y[j * to + q] = turned.real;
          y[j * to + kBlock + q] = turned.imaginary;
        }
      }
    }
  }
}

// Memory that the steps swap a block of lines with.
class Scratch {
 public:
  explicit Scratch(std::size_t length) : values_(std::make_unique_for_overwrite<float[]>(length * kPlace)) {}
  float* values() { return values_.get(); }
  // Transforms a block and returns where the result is: there or here.
  const float* transform(const FourierSteps& steps, float* block) {
    return steps.transform(block, values()) ? values() : block;
  }

 private:
  std::unique_ptr<float[]> values_;
};

// A block of sixteen columns, and of an image's rows that many wide pieces.
void copy_piece(const float* from, std::size_t width, float* to) {
  if (width == kBlock) {
    std::memcpy(to, from, kBlock * sizeof(float));  // of a known size: no call
  } else {
    std::copy_n(from, width, to);
  }
}

void load_columns(const ComplexImage& image, std::size_t column, std::size_t length, float* block) {
  const std::size_t width = std::min(kBlock, image.columns() - column);
  for (std::size_t r = 0; r < image.rows(); ++r, block += kPlace) {
    if (width < kBlock) std::fill_n(block, kPlace, 0.0F);
    copy_piece(image.real(r) + column, width, block);
    copy_piece(image.imaginary(r) + column, width, block + kBlock);
  }
  std::fill_n(block, (length - image.rows()) * kPlace, 0.0F);
}

// Of sixteen lines.
NADIR_FOR_WIDE_REGISTERS void multiply(const float* one, const float* other, std::size_t places, bool add,
                                       float* __restrict product) {
  for (std::size_t i = 0; i < places; ++i, one += kPlace, other += kPlace, product += kPlace) {
    for (std::size_t q = 0; q < kBlock; ++q) {
      // to (+)= one · conj(other)
      const float real = one[q] * other[q] + one[kBlock + q] * other[kBlock + q];
      const float imaginary = one[kBlock + q] * other[q] - one[q] * other[kBlock + q];
      product[q] = add ? product[q] + imaginary : imaginary;
      product[kBlock + q] = add ? product[kBlock + q] + real : real;
    }
  }
}

// Every number gets the magnitude 1; what is 0 stays so.
NADIR_FOR_WIDE_REGISTERS void keep_phases(std::size_t places, float* lines) {
  constexpr float kTiny = std::numeric_limits<float>::epsilon();
  for (std::size_t i = 0; i < places; ++i, lines += kPlace) {
    for (std::size_t q = 0; q < kBlock; ++q) {
      const float power = lines[q] * lines[q] + lines[kBlock + q] * lines[kBlock + q];
      const float factor = std::sqrt(power) / (power + kTiny);
      lines[q] *= factor;
      lines[kBlock + q] *= factor;
    }
  }
}

using FourFloats [[gnu::vector_size(16), gnu::aligned(4), gnu::may_alias]] = float;

// Four rows of four numbers each become four columns.
void transpose_4(const float* from, std::size_t stride, float* to, std::size_t to_stride) {
  const auto row = [&](std::size_t r) { return *reinterpret_cast<const FourFloats*>(from + r * stride); };
  const FourFloats a = row(0), b = row(1), c = row(2), d = row(3);
  const FourFloats ab = __builtin_shufflevector(a, b, 0, 4, 1, 5), ab2 = __builtin_shufflevector(a, b, 2, 6, 3, 7);
  const FourFloats cd = __builtin_shufflevector(c, d, 0, 4, 1, 5), cd2 = __builtin_shufflevector(c, d, 2, 6, 3, 7);
  const auto store = [&](std::size_t r, FourFloats value) {
    *reinterpret_cast<FourFloats*>(to + r * to_stride) = value;
  };
  store(0, __builtin_shufflevector(ab, cd, 0, 1, 4, 5));
  store(1, __builtin_shufflevector(ab, cd, 2, 3, 6, 7));
  store(2, __builtin_shufflevector(ab2, cd2, 0, 1, 4, 5));
  store(3, __builtin_shufflevector(ab2, cd2, 2, 3, 6, 7));
}

// Sixteen places of sixteen lines become sixteen places of the other direction.
void transpose_tile(const float* from, float* to) {
  for (const std::size_t part : {std::size_t{0}, kBlock}) {
    for (std::size_t r = 0; r < kBlock; r += 4) {
      for (std::size_t c = 0; c < kBlock; c += 4) {
        transpose_4(from + r * kPlace + part + c, kPlace, to + c * kPlace + part + r, kPlace);
      }
    }
  }
}

// The steps of a length; nothing where it has other factors. Eights as far as fours take the rest.
std::vector<std::size_t> radices_of(std::size_t length) {
  std::vector<std::size_t> radices;
  for (const std::size_t odd : {std::size_t{5}, std::size_t{3}}) {
    for (; length % odd == 0; length /= odd) radices.push_back(odd);
  }
  for (; length > 1 && std::bit_width(length) % 3 != 1 && length % 4 == 0; length /= 4) radices.push_back(4);
  for (; length % 8 == 0; length /= 8) radices.push_back(8);
  return length == 1 ? radices : std::vector<std::size_t>();
}

}  // namespace

ComplexImage::ComplexImage(std::size_t rows, std::size_t columns)
    : rows_(rows), columns_(columns), values_(std::make_unique_for_overwrite<float[]>(2 * rows * columns)) {}

void ComplexImage::clear() { std::fill_n(values_.get(), 2 * rows_ * columns_, 0.0F); }

NADIR_FOR_WIDE_REGISTERS void FourierSteps::run(const Step& step, const float* x, float* y) {
  const float* turns = step.turns.data();
  switch (step.radix) {
    case 3: return all_parts<3>(turns, step.parts, step.apart, x, y);
    case 4: return all_parts<4>(turns, step.parts, step.apart, x, y);
    case 5: return all_parts<5>(turns, step.parts, step.apart, x, y);
    default: return all_parts<8>(turns, step.parts, step.apart, x, y);
  }
}

FourierSteps::FourierSteps(std::size_t length) : length_(length) {
  std::size_t left = length, apart = 1;
  for (const std::size_t radix : radices_of(length)) {
    Step step{radix, left / radix, apart, {}};
    for (std::size_t p = 0; p < step.parts; ++p) {
      for (std::size_t power = 0; power < radix; ++power) {
        const double angle = -2 * std::numbers::pi * static_cast<double>(p * power) / static_cast<double>(left);
        step.turns.push_back(static_cast<float>(std::cos(angle)));
        step.turns.push_back(static_cast<float>(std::sin(angle)));
      }
    }
    left = step.parts;
    apart *= radix;
    steps_.push_back(std::move(step));
  }
}

bool FourierSteps::transform(float* block, float* other) const {
  bool swapped = false;
  for (const Step& step : steps_) {
    run(step, block, other);
    std::swap(block, other);
    swapped = !swapped;
  }
  return swapped;
}

std::complex<float> Spectrum::at(std::size_t vertical, std::size_t horizontal) const {
  const float* place = values_.get() + (vertical / kBlock * columns_ + horizontal) * kPlace + vertical % kBlock;
  return {place[0], place[kBlock]};
}

FourierTransform::FourierTransform(std::size_t rows, std::size_t columns) : vertical_(rows), horizontal_(columns) {}

Spectrum FourierTransform::forward(const ComplexImage& image) const {
  Spectrum spectrum(rows(), columns());
  const std::size_t used = std::min(columns(), (image.columns() + kBlock - 1) / kBlock * kBlock);
  const std::size_t block = columns() * kPlace;
  Scratch loaded(rows()), vertical_scratch(rows());
  for (std::size_t c = 0; c < used; c += kBlock) {
    load_columns(image, c, rows(), loaded.values());
    const float* result = vertical_scratch.transform(vertical_, loaded.values());
    for (std::size_t r = 0; r < rows(); r += kBlock) {
      transpose_tile(result + r * kPlace, spectrum.values_.get() + r / kBlock * block + c * kPlace);
    }
  }
  Scratch horizontal_scratch(columns());
  for (std::size_t r = 0; r < rows(); r += kBlock) {
    float* lines = spectrum.values_.get() + r / kBlock * block;
    std::fill(lines + used * kPlace, lines + block, 0.0F);
    const float* result = horizontal_scratch.transform(horizontal_, lines);
    if (result != lines) std::copy_n(result, block, lines);
  }
  return spectrum;
}

// The inverse of a transform is the transform with both parts swapped before and after. `lines` gives those of a block,
// swapped.
template <typename Lines>
ComplexImage FourierTransform::inverse(std::size_t out_rows, std::size_t out_columns, const Lines& lines) const {
  const std::size_t used = (out_columns + kBlock - 1) / kBlock * kBlock;
  const auto half_way = std::make_unique_for_overwrite<float[]>(used * rows() * 2);
  Scratch block(columns()), horizontal_scratch(columns());
  for (std::size_t r = 0; r < rows(); r += kBlock) {
    lines(r * columns() * 2, block.values());
    const float* result = horizontal_scratch.transform(horizontal_, block.values());
    for (std::size_t c = 0; c < used; c += kBlock) {
      transpose_tile(result + c * kPlace, half_way.get() + (c / kBlock * rows() + r) * kPlace);
    }
  }
  ComplexImage image(out_rows, out_columns);
  Scratch vertical_scratch(rows());
  for (std::size_t c = 0; c < out_columns; c += kBlock) {
    const std::size_t width = std::min(kBlock, out_columns - c);
    const float* result = vertical_scratch.transform(vertical_, half_way.get() + c / kBlock * rows() * kPlace);
    for (std::size_t r = 0; r < out_rows; ++r, result += kPlace) {
      copy_piece(result + kBlock, width, image.real(r) + c);
      copy_piece(result, width, image.imaginary(r) + c);
    }
  }
  return image;
}

ComplexImage FourierTransform::correlation(std::span<const Spectrum> ones, std::span<const Spectrum> others,
                                           std::size_t out_rows, std::size_t out_columns) const {
  return inverse(out_rows, out_columns, [&](std::size_t at, float* lines) {
    for (std::size_t k = 0; k < ones.size(); ++k) {
      multiply(ones[k].values_.get() + at, others[k].values_.get() + at, columns(), k > 0, lines);
    }
  });
}

ComplexImage FourierTransform::phase_correlation(const Spectrum& one, const Spectrum& other) const {
  return inverse(rows(), columns(), [&](std::size_t at, float* lines) {
    multiply(one.values_.get() + at, other.values_.get() + at, columns(), false, lines);
    keep_phases(columns(), lines);
  });
}

std::size_t FourierTransform::fitting_length(std::size_t least) {
  std::size_t length = std::max(kBlock, (least + kBlock - 1) / kBlock * kBlock);
  while (radices_of(length).empty()) length += kBlock;
  return length;
}

}  // namespace nadir
