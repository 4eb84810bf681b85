// Sets of things that are connected, directly or through others (union and find; Galler and Fischer 1964).
#pragma once

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <vector>

namespace nadir {

// Things are numbered from 0. A set is known by the least number in it.
template <typename Index>
class DisjointSets {
 public:
  explicit DisjointSets(std::size_t count) : parent_(count) { std::iota(parent_.begin(), parent_.end(), Index{0}); }
  Index root(Index i) const {
    while (parent_[i] != i) i = parent_[i];
    return i;
  }
  void join(Index a, Index b) {
    const Index of_a = shortened(a), of_b = shortened(b);
    parent_[std::max(of_a, of_b)] = std::min(of_a, of_b);
  }

 private:
  // root(), on half of the way from now on.
  Index shortened(Index i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }

  std::vector<Index> parent_;
};

}  // namespace nadir
