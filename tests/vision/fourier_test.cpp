#include "vision/fourier.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <numbers>

#include "base/random.hpp"

namespace nadir {
namespace {

using Complex = std::complex<double>;

ComplexImage random_image(std::size_t rows, std::size_t columns, std::uint64_t seed) {
  Random random(seed);
  ComplexImage image(rows, columns);
  for (std::size_t r = 0; r < rows; ++r) {
    for (std::size_t c = 0; c < columns; ++c) {
      image.real(r)[c] = static_cast<float>(random.normal(0.3, 1));
      image.imaginary(r)[c] = static_cast<float>(random.normal(0, 1));
    }
  }
  return image;
}

// The definition, one dimension after the other.
std::vector<std::vector<Complex>> defined_spectrum(const ComplexImage& image, std::size_t rows, std::size_t columns) {
  const auto turn = [](std::size_t k, std::size_t i, std::size_t length) {
    return std::polar(1.0, -2 * std::numbers::pi * static_cast<double>(k * i % length) / static_cast<double>(length));
  };
  std::vector<std::vector<Complex>> along(image.rows(), std::vector<Complex>(columns));
  for (std::size_t r = 0; r < image.rows(); ++r) {
    for (std::size_t k = 0; k < columns; ++k) {
      for (std::size_t c = 0; c < image.columns(); ++c) {
        along[r][k] += Complex(static_cast<double>(image.real(r)[c]), static_cast<double>(image.imaginary(r)[c])) *
                       turn(k, c, columns);
      }
    }
  }
  std::vector<std::vector<Complex>> spectrum(rows, std::vector<Complex>(columns));
  for (std::size_t k = 0; k < rows; ++k) {
    for (std::size_t c = 0; c < columns; ++c) {
      for (std::size_t r = 0; r < image.rows(); ++r) spectrum[k][c] += along[r][c] * turn(k, r, rows);
    }
  }
  return spectrum;
}

struct Sizes {
  std::size_t rows, columns, image_rows, image_columns;
};

class FourierSizes : public testing::TestWithParam<Sizes> {};
INSTANTIATE_TEST_SUITE_P(Fourier, FourierSizes,
                         testing::Values(Sizes{16, 16, 16, 16}, Sizes{32, 48, 20, 17}, Sizes{96, 64, 96, 33},
                                         Sizes{48, 128, 1, 128}, Sizes{64, 16, 7, 1}));

TEST_P(FourierSizes, EqualsTheDefinition) {
  const auto [rows, columns, image_rows, image_columns] = GetParam();
  const ComplexImage image = random_image(image_rows, image_columns, 5);
  const ComplexImage spectrum = FourierTransform(rows, columns).forward(image);
  const auto expected = defined_spectrum(image, rows, columns);
  double worst = 0;
  for (std::size_t r = 0; r < rows; ++r) {
    for (std::size_t c = 0; c < columns; ++c) {
      const Complex found(static_cast<double>(spectrum.real(c)[r]), static_cast<double>(spectrum.imaginary(c)[r]));
      worst = std::max(worst, std::abs(found - expected[r][c]));
    }
  }
  EXPECT_LT(worst, 2e-6 * static_cast<double>(rows * columns));
}

TEST_P(FourierSizes, TheInverseReturnsTheImage) {
  const auto [rows, columns, image_rows, image_columns] = GetParam();
  const ComplexImage image = random_image(image_rows, image_columns, 6);
  const FourierTransform transform(rows, columns);
  ComplexImage spectrum = transform.forward(image);
  const ComplexImage back = transform.inverse(spectrum, image_rows, image_columns);
  const auto area = static_cast<float>(rows * columns);
  for (std::size_t r = 0; r < image_rows; ++r) {
    for (std::size_t c = 0; c < image_columns; ++c) {
      ASSERT_NEAR(back.real(r)[c] / area, image.real(r)[c], 1e-5);
      ASSERT_NEAR(back.imaginary(r)[c] / area, image.imaginary(r)[c], 1e-5);
    }
  }
}

TEST(Fourier, LengthsFit) {
  EXPECT_EQ(FourierTransform::fitting_length(1), 16U);
  EXPECT_EQ(FourierTransform::fitting_length(17), 32U);
  EXPECT_EQ(FourierTransform::fitting_length(33), 48U);
  EXPECT_EQ(FourierTransform::fitting_length(49), 64U);
  EXPECT_EQ(FourierTransform::fitting_length(385), 512U);
  EXPECT_EQ(FourierTransform::fitting_length(512), 512U);
}

}  // namespace
}  // namespace nadir
