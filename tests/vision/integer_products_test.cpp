#include "vision/integer_products.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "base/random.hpp"

namespace nadir {
namespace {

struct Case {
  std::size_t rows, blocks, stride, count;
  bool extreme;
};

class IntegerProducts : public testing::TestWithParam<Case> {};
INSTANTIATE_TEST_SUITE_P(All, IntegerProducts,
                         testing::Values(Case{1, 1, 1, 1, false}, Case{5, 3, 6, 2, false}, Case{48, 18, 6, 5, false},
                                         Case{24, 9, 6, 13, false}, Case{3, 2, 12, 17, false}, Case{0, 1, 6, 3, false},
                                         Case{90, 60, 6, 7, true}));  // sums far beyond 32 bits

TEST_P(IntegerProducts, EqualTheSumOnEveryPath) {
  const auto [rows, blocks, stride, count, extreme] = GetParam();
  const std::size_t length = blocks * kProductBlock, width = length + count * stride;
  Random random(3);
  const auto values = [&](std::size_t size) {
    std::vector<std::int16_t> made(size);
    for (std::int16_t& value : made) {
      value = extreme ? std::int16_t{-511} : static_cast<std::int16_t>(random.uniform(-511, 512));
    }
    return made;
  };
  const std::vector<std::int16_t> pattern = values(rows * length), window = values(rows * width);
  std::vector<ProductRow> lines;
  for (std::size_t r = 0; r < rows; ++r)
    lines.push_back({pattern.data() + r * length, window.data() + r * width, blocks});
  std::vector<std::int64_t> found(count, 1), portable(count, 1), expected(count, 0);
  sum_products(lines, stride, count, found.data());
  sum_products_portable(lines, stride, count, portable.data());
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t r = 0; r < rows; ++r) {
      for (std::size_t k = 0; k < length; ++k) {
        expected[i] += std::int64_t{pattern[r * length + k]} * window[r * width + i * stride + k];
      }
    }
  }
  EXPECT_EQ(found, expected);
  EXPECT_EQ(portable, expected);
}

}  // namespace
}  // namespace nadir
