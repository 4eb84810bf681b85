#include "vision/integer_products.hpp"

#if defined(__x86_64__)
#include <immintrin.h>
#endif

#include <algorithm>
#include <array>

namespace nadir {

#if defined(__x86_64__)
namespace {

// A lane of 32 bits adds two products up to 511² each time: so many fit.
constexpr std::size_t kMostAdditions = 4000;

// Several placements at once read the template once.
template <std::size_t kPlacements>
__attribute__((target("avx2"))) void placements_avx2(std::span<const ProductRow> rows, std::size_t stride,
                                                     std::size_t from, std::int64_t* products) {
  __m256i sums[kPlacements];
  for (__m256i& sum : sums) sum = _mm256_setzero_si256();
  std::fill_n(products, kPlacements, std::int64_t{0});
  std::size_t additions = 0;
  const auto take = [&]() __attribute__((target("avx2"))) {
    for (std::size_t i = 0; i < kPlacements; ++i) {
      alignas(32) std::array<std::int32_t, 8> lanes;
      _mm256_store_si256(reinterpret_cast<__m256i*>(lanes.data()), sums[i]);
      for (const std::int32_t lane : lanes) products[i] += lane;
      sums[i] = _mm256_setzero_si256();
    }
    additions = 0;
  };
  for (const ProductRow& row : rows) {
    const std::int16_t *pattern = row.pattern, *window = row.window + from * stride;
    for (std::size_t done = 0; done < row.blocks;) {
      const std::size_t end = std::min(row.blocks, done + kMostAdditions - additions);
      additions += end - done;
      for (; done < end; ++done, pattern += kProductBlock, window += kProductBlock) {
        const __m256i values = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(pattern));
        for (std::size_t i = 0; i < kPlacements; ++i) {
          const __m256i there = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(window + i * stride));
          sums[i] = _mm256_add_epi32(sums[i], _mm256_madd_epi16(values, there));
        }
      }
      if (additions == kMostAdditions) take();
    }
  }
  take();
}

void sum_products_avx2(std::span<const ProductRow> rows, std::size_t stride, std::size_t count,
                       std::int64_t* products) {
  constexpr std::array kSizes{&placements_avx2<1>, &placements_avx2<2>, &placements_avx2<3>,
                              &placements_avx2<4>, &placements_avx2<5>, &placements_avx2<6>};
  for (std::size_t i = 0; i < count;) {
    const std::size_t groups = (count - i + kSizes.size() - 1) / kSizes.size();
    const std::size_t size = (count - i + groups - 1) / groups;
    kSizes[size - 1](rows, stride, i, products + i);
    i += size;
  }
}

}  // namespace

void sum_products(std::span<const ProductRow> rows, std::size_t stride, std::size_t count, std::int64_t* products) {
  static const bool wide = __builtin_cpu_supports("avx2") != 0;
  (wide ? sum_products_avx2 : sum_products_portable)(rows, stride, count, products);
}
#else
void sum_products(std::span<const ProductRow> rows, std::size_t stride, std::size_t count, std::int64_t* products) {
  sum_products_portable(rows, stride, count, products);
}
#endif

void sum_products_portable(std::span<const ProductRow> rows, std::size_t stride, std::size_t count,
                           std::int64_t* products) {
  constexpr std::size_t kMostBlocks = 500;  // sixteen products up to 511² each fit into 32 bits so often
  for (std::size_t i = 0; i < count; ++i) {
    std::int64_t total = 0;
    for (const ProductRow& row : rows) {
      for (std::size_t done = 0; done < row.blocks; done += kMostBlocks) {
        const std::int16_t *pattern = row.pattern + done * kProductBlock,
                           *window = row.window + i * stride + done * kProductBlock;
        const std::size_t length = std::min(kMostBlocks, row.blocks - done) * kProductBlock;
        std::int32_t sum = 0;
        for (std::size_t k = 0; k < length; ++k) sum += pattern[k] * window[k];
        total += sum;
      }
    }
    products[i] = total;
  }
}

}  // namespace nadir
