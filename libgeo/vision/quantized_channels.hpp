// Channels as small integers, for direct correlation (correlation.hpp): exact, the same on every processor, and a
// fraction of the cost of floats.
//
// Steps of 1/256, at most ±511, each channel's mean removed. The six orientations are made from a picture in integers
// as well (quantized_channels()): the formula of oriented_channels.hpp with binomials (1 4 6 4 1) / 16, whose variance
// is 1, for G_σ and two means of five pixels after each other, whose variance is 4, for G_pool.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <opencv2/core/mat.hpp>

#include "vision/oriented_channels.hpp"

namespace nadir {

class QuantizedChannels {
 public:
  explicit QuantizedChannels(const Channels& channels);

  cv::Size size() const { return mask_.size(); }
  const cv::Mat& mask() const { return mask_; }
  std::size_t channels() const { return channels_; }
  bool means_removed() const { return means_removed_; }
  bool whole() const { return whole_; }  // no pixel is masked
  // All channels of a pixel side by side; 0, which is the mean, where the mask is. Sixteen values beyond the last may
  // be read.
  const std::int16_t* at(int row, int column) const {
    return values_.get() +
           (static_cast<std::size_t>(row) * static_cast<std::size_t>(mask_.cols) + static_cast<std::size_t>(column)) *
               channels_;
  }

  // Half the resolution: means of 2 x 2 pixels, the first of which begin at `first` (0 or 1 each). Valid where all four
  // are.
  QuantizedChannels halved(cv::Point first) const;

 private:
  friend QuantizedChannels quantized_channels(const cv::Mat&, const cv::Mat&, ChannelSet, const ChannelOptions&);
  QuantizedChannels(cv::Mat mask, std::size_t channels, bool means_removed);

  cv::Mat mask_;
  std::size_t channels_ = 0;
  bool means_removed_ = true;
  bool whole_ = true;
  std::unique_ptr<std::int16_t[]> values_;  // not a vector, which would be filled with zeros first
};

// Of a picture. In integers throughout for the six orientations with the default smoothing; other sets and options,
// which are for comparison, go by oriented_channels().
QuantizedChannels quantized_channels(const cv::Mat& grey, const cv::Mat& mask, ChannelSet set,
                                     const ChannelOptions& options = {});

}  // namespace nadir
