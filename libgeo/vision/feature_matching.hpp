// Which features of two images are the same: nearest descriptors, by the ratio test (Lowe 2004).
//
// SIFT's descriptors are whole numbers from 0 to 255, so distances are computed in integers: exact, the same on every
// processor, and a fraction of the cost of floats.
#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <span>
#include <vector>

namespace nadir {

class FeatureDescriptors {
 public:
  static constexpr std::size_t kLength = 128;

  FeatureDescriptors() = default;
  // rows: CV_32FC1, one descriptor of 128 whole numbers from 0 to 255 a row; empty for none.
  explicit FeatureDescriptors(const cv::Mat& rows);

  void add(std::span<const std::int16_t, kLength> descriptor);  // whole numbers from 0 to 255

  std::size_t size() const { return squares_.size(); }
  const std::int16_t* at(std::size_t i) const { return values_.data() + i * kLength; }
  std::int32_t square(std::size_t i) const { return squares_[i]; }  // sum of squares

 private:
  std::vector<std::int16_t> values_;
  std::vector<std::int32_t> squares_;
};

struct FeatureMatch {
  std::size_t first = 0, second = 0;  // indices into both sets
};

// For each of `first` its nearest of `second`, if that is nearer than `ratio` times the second nearest. In the order of
// `first`; none when `second` has less than two.
std::vector<FeatureMatch> unambiguous_matches(const FeatureDescriptors& first, const FeatureDescriptors& second,
                                              double ratio);

}  // namespace nadir
