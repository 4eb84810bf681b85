#include "vision/frozen_frame.hpp"

#include <cstring>

namespace nadir {
namespace {

// FNV-1a over words of eight bytes: quick, and two noisy pictures that share it are not to be expected in any flight.
std::uint64_t fingerprint(const cv::Mat& picture) {
  constexpr std::uint64_t kPrime = 0x100000001b3;
  std::uint64_t hash = 0xcbf29ce484222325 ^ static_cast<std::uint64_t>(picture.cols);
  const std::size_t bytes = static_cast<std::size_t>(picture.cols) * picture.elemSize();
  for (int row = 0; row < picture.rows; ++row) {
    const auto* at = picture.ptr<std::uint8_t>(row);
    std::size_t i = 0;
    for (; i + 8 <= bytes; i += 8) {
      std::uint64_t word = 0;
      std::memcpy(&word, at + i, 8);
      hash = (hash ^ word) * kPrime;
      hash ^= hash >> 29;
    }
    for (; i < bytes; ++i) hash = (hash ^ at[i]) * kPrime;
  }
  return hash;
}

}  // namespace

bool FrozenFrame::again(const cv::Mat& picture) {
  if (picture.empty()) return false;
  const std::uint64_t now = fingerprint(picture);
  const bool same = last_ == now;
  last_ = now;
  return same;
}

}  // namespace nadir
