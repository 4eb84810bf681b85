// How long things took, in bins of a millisecond: constant memory however long the flight.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace nadir {

class LatencyHistogram {
 public:
  void add(double seconds) {
    const double ms = std::clamp(std::floor(seconds * 1000), 0.0, static_cast<double>(bins_.size() - 1));
    ++bins_[static_cast<std::size_t>(ms)];
    ++count_;
    largest_s_ = std::max(largest_s_, seconds);
  }

  std::uint64_t count() const { return count_; }
  double largest_s() const { return largest_s_; }

  // Upper end of the bin that holds this share of all; 0 without any. What took longer than two seconds counts as two.
  double quantile_s(double share) const {
    const double wanted = share * static_cast<double>(count_);
    std::uint64_t sum = 0;
    for (std::size_t i = 0; i < bins_.size() && count_ != 0; ++i) {
      sum += bins_[i];
      if (static_cast<double>(sum) >= wanted) return static_cast<double>(i + 1) / 1000;
    }
    return 0;
  }

 private:
  std::array<std::uint32_t, 2000> bins_{};
  std::uint64_t count_ = 0;
  double largest_s_ = 0;
};

}  // namespace nadir
