#include "imagery/fourier.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "base/digest.hpp"
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
                                         Sizes{48, 128, 1, 128}, Sizes{64, 16, 7, 1}, Sizes{80, 144, 40, 50},
                                         Sizes{400, 160, 9, 30}, Sizes{16, 512, 3, 20}));

TEST_P(FourierSizes, EqualsTheDefinition) {
  const auto [rows, columns, image_rows, image_columns] = GetParam();
  const ComplexImage image = random_image(image_rows, image_columns, 5);
  const Spectrum spectrum = FourierTransform(rows, columns).forward(image);
  const auto expected = defined_spectrum(image, rows, columns);
  double worst = 0;
  for (std::size_t r = 0; r < rows; ++r) {
    for (std::size_t c = 0; c < columns; ++c) {
      worst = std::max(worst, std::abs(Complex(spectrum.at(r, c)) - expected[r][c]));
    }
  }
  EXPECT_LT(worst, 2e-6 * static_cast<double>(rows * columns));
}

TEST_P(FourierSizes, CorrelatedWithOnePixelItIsTheImage) {
  const auto [rows, columns, image_rows, image_columns] = GetParam();
  const ComplexImage image = random_image(image_rows, image_columns, 6);
  const FourierTransform transform(rows, columns);
  ComplexImage pixel(1, 1);
  *pixel.real(0) = 1, *pixel.imaginary(0) = 0;
  const Spectrum one = transform.forward(image), other = transform.forward(pixel);
  const ComplexImage back = transform.correlation({&one, 1}, {&other, 1}, image_rows, image_columns);
  const auto area = static_cast<float>(rows * columns);
  for (std::size_t r = 0; r < image_rows; ++r) {
    for (std::size_t c = 0; c < image_columns; ++c) {
      ASSERT_NEAR(back.real(r)[c] / area, image.real(r)[c], 1e-5);
      ASSERT_NEAR(back.imaginary(r)[c] / area, image.imaginary(r)[c], 1e-5);
    }
  }
}

// Every pixel of the result is a sum over all placements, which ends at the far side of the transform and begins again.
TEST_P(FourierSizes, CorrelationsAreTheirSums) {
  const auto [rows, columns, image_rows, image_columns] = GetParam();
  const FourierTransform transform(rows, columns);
  constexpr std::size_t kPatternSide = 3;
  std::vector<ComplexImage> images, patterns;
  std::vector<Spectrum> ones, others;
  for (const std::uint64_t seed : {6U, 7U}) {
    images.push_back(random_image(image_rows, image_columns, seed));
    patterns.push_back(random_image(kPatternSide, kPatternSide, seed + 10));
    ones.push_back(transform.forward(images.back()));
    others.push_back(transform.forward(patterns.back()));
  }
  const ComplexImage found = transform.correlation(ones, others, image_rows, image_columns);
  ASSERT_EQ(found.rows(), image_rows);
  ASSERT_EQ(found.columns(), image_columns);
  const auto number = [](const ComplexImage& image, std::size_t r, std::size_t c) {
    if (r >= image.rows() || c >= image.columns()) return Complex();
    return Complex(static_cast<double>(image.real(r)[c]), static_cast<double>(image.imaginary(r)[c]));
  };
  const auto area = static_cast<double>(rows * columns);
  for (std::size_t r = 0; r < image_rows; ++r) {
    for (std::size_t c = 0; c < image_columns; ++c) {
      Complex expected;
      for (std::size_t k = 0; k < images.size(); ++k) {
        for (std::size_t y = 0; y < kPatternSide; ++y) {
          for (std::size_t x = 0; x < kPatternSide; ++x) {
            expected += number(images[k], (r + y) % rows, (c + x) % columns) * std::conj(number(patterns[k], y, x));
          }
        }
      }
      ASSERT_NEAR(std::abs(number(found, r, c) / area - expected), 0, 1e-4) << r << ", " << c;
    }
  }
}

// The second image is the first one, moved: all frequencies agree on one place, as strongly as they can.
TEST_P(FourierSizes, PhasesAgreeOnTheShift) {
  const auto [rows, columns, image_rows, image_columns] = GetParam();
  const FourierTransform transform(rows, columns);
  const ComplexImage image = random_image(rows, columns, 8);
  ComplexImage moved(rows, columns);
  for (std::size_t r = 0; r < rows; ++r) {
    for (std::size_t c = 0; c < columns; ++c) {
      moved.real(r)[c] = 3 * image.real((r + 5) % rows)[(c + columns - 2) % columns];
      moved.imaginary(r)[c] = 3 * image.imaginary((r + 5) % rows)[(c + columns - 2) % columns];
    }
  }
  const ComplexImage found = transform.phase_correlation(transform.forward(image), transform.forward(moved));
  const auto area = static_cast<float>(rows * columns);
  for (std::size_t r = 0; r < rows; ++r) {
    for (std::size_t c = 0; c < columns; ++c) {
      ASSERT_NEAR(found.real(r)[c] / area, r == 5 && c == columns - 2 ? 1 : 0, 1e-4) << r << ", " << c;
    }
  }
}

// Of an image without structure: nothing, and no division by zero.
TEST(Fourier, PhasesOfNothingAreNothing) {
  const FourierTransform transform(16, 16);
  ComplexImage even(16, 16);
  even.clear();
  const ComplexImage found = transform.phase_correlation(transform.forward(even), transform.forward(even));
  EXPECT_EQ(*std::max_element(found.real(0), found.real(0) + 256), 0);
}

// Whatever the processor, the width of its registers and the compiler's options: recordings are replayed bit for bit.
TEST(Fourier, BitsAreTheSameEverywhere) {
  Random random(9);
  const auto image = [&random](std::size_t rows, std::size_t columns) {
    ComplexImage result(rows, columns);
    float* values = result.real(0);
    std::generate_n(values, 2 * rows * columns, [&] { return static_cast<float>(random.uniform(-1, 1)); });
    return result;
  };
  Bytes bytes;
  const auto keep = [&bytes](const ComplexImage& result) {
    const auto* begin = reinterpret_cast<const std::uint8_t*>(result.real(0));
    bytes.insert(bytes.end(), begin, begin + 2 * result.rows() * result.columns() * sizeof(float));
  };
  for (const auto& [rows, columns] : {std::pair<std::size_t, std::size_t>{48, 80}, {144, 160}, {400, 512}}) {
    const FourierTransform transform(rows, columns);
    const Spectrum one = transform.forward(image(rows, columns)), other = transform.forward(image(rows / 2, 33));
    keep(transform.correlation({&one, 1}, {&other, 1}, rows / 2, columns - 7));
    keep(transform.phase_correlation(one, other));
  }
  EXPECT_EQ(sha256(bytes).hex(), "32a7543656cba0eb735d19b26f4786e68624c9025fc173e9c432ffa4e4ef709d");
}

TEST(Fourier, LengthsFit) {
  EXPECT_EQ(FourierTransform::fitting_length(1), 16U);
  EXPECT_EQ(FourierTransform::fitting_length(17), 32U);
  EXPECT_EQ(FourierTransform::fitting_length(33), 48U);
  EXPECT_EQ(FourierTransform::fitting_length(49), 64U);
  EXPECT_EQ(FourierTransform::fitting_length(65), 80U);
  EXPECT_EQ(FourierTransform::fitting_length(385), 400U);
  EXPECT_EQ(FourierTransform::fitting_length(512), 512U);
  EXPECT_EQ(FourierTransform::fitting_length(513), 576U);
}

}  // namespace
}  // namespace nadir
