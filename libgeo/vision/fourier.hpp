// Discrete Fourier transforms of complex images in single precision, for correlation over many placements.
//
// Stockham's radix-4 steps over blocks of sixteen columns that stay in the first-level cache; each lane of a register
// is one column, so the bits are the same whatever the width of the registers.
#pragma once

#include <cstddef>
#include <memory>
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

  static constexpr std::size_t kColumns = 16;  // of a block
  // Of `length` rows of kColumns numbers each; the result lies in the first pair or, when it returns true, in the
  // second.
  bool transform(float* real, float* imaginary, float* other_real, float* other_imaginary) const;

 private:
  struct Step {
    std::size_t radix = 4, parts = 1, apart = 1;
    std::vector<float> turns;  // real and imaginary of w, w² (and w³) for each part
  };
  std::size_t length_;
  std::vector<Step> steps_;
};

class FourierTransform {
 public:
  FourierTransform(std::size_t rows, std::size_t columns);

  std::size_t rows() const { return along_rows_.length(); }
  std::size_t columns() const { return along_columns_.length(); }

  // The spectrum of an image of at most rows() times columns(), filled up with zeros. It is transposed: row k belongs
  // to the horizontal frequency k, column k to the vertical one.
  ComplexImage forward(const ComplexImage& image) const;
  // The upper left part of the image with that spectrum, not divided by rows() times columns(). The spectrum is used
  // up.
  ComplexImage inverse(ComplexImage& spectrum, std::size_t rows, std::size_t columns) const;

  // The next length that is as fast to transform as can be: a power of two of at least 16, or three times one.
  static std::size_t fitting_length(std::size_t least);

 private:
  FourierSteps along_rows_, along_columns_;  // of a vertical line, of a horizontal one
};

}  // namespace nadir
