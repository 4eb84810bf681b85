// The file index/places.faiss: one vector per chunk in a flat index of FAISS (IndexFlatIP), searched for the largest
// inner products. A flat search is exact, needs no training, and gives the same answer everywhere; 50 000 vectors take
// 25.6 MB and some milliseconds a query.
#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "base/bytes.hpp"
#include "base/progress.hpp"
#include "vision/place_projection.hpp"

namespace nadir {

class PlaceVectors {
 public:
  explicit PlaceVectors(std::span<const PlaceVector> vectors);
  // Throws Error unless the bytes are a flat inner-product index of exactly `count` vectors of kPlaceSize, to the byte:
  // sizes are compared before anything is allocated for them.
  PlaceVectors(ByteView file, std::size_t count, std::string_view name);
  ~PlaceVectors();
  PlaceVectors(PlaceVectors&&) noexcept;
  PlaceVectors& operator=(PlaceVectors&&) noexcept;

  Bytes file() const;
  std::size_t size() const;
  std::span<const float> vector(std::size_t index) const;

  struct Hit {
    std::size_t index = 0;
    float score = -1;
  };
  // Of the vectors first … first + count − 1: for each query the `best` nearest, best first, fewer when there are
  // fewer. The same on any number of threads. `cancel` is asked before each batch of queries.
  std::vector<std::vector<Hit>> search(std::span<const PlaceVector> queries, std::size_t first, std::size_t count,
                                       std::size_t best, const Cancel& cancel = {}) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace nadir
