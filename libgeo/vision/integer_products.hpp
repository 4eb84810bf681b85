// Sums of products of small integers: what direct correlation spends its time on. With AVX2 where the processor has it;
// whole numbers, so the result is the same everywhere.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace nadir {

inline constexpr std::size_t kProductBlock = 16;  // values that are read at once

// A row of a template and where it lies first in the window: `blocks` times kProductBlock values of each. A template's
// row that ends earlier is filled up with zeros.
struct ProductRow {
  const std::int16_t* pattern = nullptr;
  const std::int16_t* window = nullptr;
  std::size_t blocks = 0;
};

// products[i] = Σ over the rows, Σ over k of pattern[k] · window[i · stride + k], for i < count. Values up to ±511.
void sum_products(std::span<const ProductRow> rows, std::size_t stride, std::size_t count, std::int64_t* products);
// The same without AVX2.
void sum_products_portable(std::span<const ProductRow> rows, std::size_t stride, std::size_t count,
                           std::int64_t* products);

}  // namespace nadir
