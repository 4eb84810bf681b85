// The same correlation as in correlation.hpp, for few placements: a patch within some pixels of where it should be.
// There a direct sum over whole numbers is far cheaper than transforms, and the same on every processor.
//
// Channels are kept as whole numbers (1/256 steps, at most ±511), all channels of a pixel side by side.
#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "vision/oriented_channels.hpp"

namespace nadir {

class QuantizedChannels {
 public:
  explicit QuantizedChannels(const Channels& channels);

  cv::Size size() const { return mask_.size(); }
  const cv::Mat& mask() const { return mask_; }

 private:
  friend class LocalTemplate;

  cv::Mat mask_;
  std::size_t channels_ = 0;
  bool means_removed_ = true;
  // Not vectors, because those would be filled with zeros first: megabytes for each picture.
  std::unique_ptr<std::int16_t[]> values_;   // row by row, pixel by pixel, less the mean, 0 where the mask is
  std::unique_ptr<std::int32_t[]> sums_;     // of each channel from the row's begin to before the pixel; one more a row
  std::unique_ptr<std::int64_t[]> squares_;  // of all channels, likewise
  std::unique_ptr<std::int32_t[]> valid_;    // pixels, likewise
};

// A part of a picture, to be looked for in another one.
class LocalTemplate {
 public:
  // `of` must outlive it; `part` lies inside.
  LocalTemplate(const QuantizedChannels& of, const cv::Rect& part);

  // Scores (CV_32FC1) with the pattern's top-left corner at `first` of `window` and at placements.width - 1 further
  // ones to the right and placements.height - 1 down, `step` pixels apart, all inside the window. -1 where less than
  // `min_valid` of the pattern lies on what is valid there.
  cv::Mat scores(const QuantizedChannels& window, cv::Point first, cv::Size placements, double min_valid = 0.6,
                 int step = 1) const;

 private:
  struct Run {  // of valid pixels in a row of the pattern
    int row = 0, begin = 0, end = 0;
  };
  const QuantizedChannels* of_;
  cv::Rect part_;
  std::vector<Run> runs_;
  double pixels_ = 0;
  double energy_ = 0;         // sum of squares, the channels' means removed
  std::vector<double> sums_;  // of each channel
};

}  // namespace nadir
