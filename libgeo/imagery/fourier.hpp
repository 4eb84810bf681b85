// Discrete Fourier transforms of complex images in single precision, for correlations of images.
//
// Stockham's steps of radix 8, 4, 3 and 5 (Van Loan 1992) over blocks of sixteen lines that stay in the nearest
// caches; each lane of a register is one line, so the bits are the same whatever the width of the registers. What goes
// from one direction to the other lies in memory block by block, in the order in which it is read.
#pragma once

#include <complex>
#include <cstddef>
#include <memory>
#include <span>
#include <vector>

namespace nadir {

// Real and imaginary parts, each `rows` times `columns`, row by row.
class ComplexImage {
 public:
  ComplexImage(std::size_t rows, std::size_t columns);

  std::size_t rows() const { return rows_; }
  std::size_t columns() const { return columns_; }
  float* real(std::size_t row) { return values_.get() + row * columns_; }
  float* imaginary(std::size_t row) { return values_.get() + (rows_ + row) * columns_; }
  const float* real(std::size_t row) const { return values_.get() + row * columns_; }
  const float* imaginary(std::size_t row) const { return values_.get() + (rows_ + row) * columns_; }
  void clear();

 private:
  std::size_t rows_, columns_;
  std::unique_ptr<float[]> values_;  // not a vector, which would be filled with zeros first
};

// Along one dimension, of a length that fitting_length() returns.
class FourierSteps {
 public:
  explicit FourierSteps(std::size_t length);
  std::size_t length() const { return length_; }

  static constexpr std::size_t kLines = 16;  // of a block
  // A block of `length` places, of each the real parts of kLines lines and then their imaginary parts. True: the result
  // lies in the other block.
  bool transform(float* block, float* other) const;

 private:
  struct Step {
    std::size_t radix = 4, parts = 1, apart = 1;
    std::vector<float> turns;  // real and imaginary of 1, w, w², … for each part
  };
  static void run(const Step& step, const float* x, float* y);

  std::size_t length_;
  std::vector<Step> steps_;
};

// Of an image, in the order in which a transform works: blocks of sixteen vertical frequencies, in each of them one
// horizontal frequency after the other. Spectra of one transform have the same order.
class Spectrum {
 public:
  std::complex<float> at(std::size_t vertical, std::size_t horizontal) const;

 private:
  friend class FourierTransform;
  Spectrum(std::size_t rows, std::size_t columns)
      : columns_(columns), values_(std::make_unique_for_overwrite<float[]>(2 * rows * columns)) {}

  std::size_t columns_;
  std::unique_ptr<float[]> values_;
};

class FourierTransform {
 public:
  FourierTransform(std::size_t rows, std::size_t columns);

  std::size_t rows() const { return vertical_.length(); }
  std::size_t columns() const { return horizontal_.length(); }

  // The spectrum of an image of at most rows() times columns(), filled up with zeros.
  Spectrum forward(const ComplexImage& image) const;
  // The upper left part of the image whose spectrum is Σ_k ones[k] · conj(others[k]), of at least one pair: the sum of
  // the correlations, not divided by rows() times columns().
  ComplexImage correlation(std::span<const Spectrum> ones, std::span<const Spectrum> others, std::size_t rows,
                           std::size_t columns) const;
  // The correlation of two images in which every frequency counts the same (Kuglin and Hines 1975): of rows() times
  // columns().
  ComplexImage phase_correlation(const Spectrum& one, const Spectrum& other) const;

  // The length of at least `least` that is transformed with the least work.
  static std::size_t fitting_length(std::size_t least);

 private:
  template <typename Lines>
  ComplexImage inverse(std::size_t rows, std::size_t columns, const Lines& lines) const;

  FourierSteps vertical_, horizontal_;
};

}  // namespace nadir
