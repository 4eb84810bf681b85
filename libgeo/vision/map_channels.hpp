// The channels of a piece of the map, made once for all that is compared with it.
#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>

#include "vision/near_correlation.hpp"

namespace nadir {

class MapChannels {
 public:
  // image: grey; mask: 0 where there is no map. Both are shared, not copied.
  MapChannels(cv::Mat image, cv::Mat mask, ChannelSet set, const ChannelOptions& options);

  cv::Size map_size() const { return image_.size(); }
  // Makes them over `part` of the map's pixels and some more, unless they are there already. What lies beyond the map
  // is not valid.
  void cover(const cv::Rect& part);
  // Of what was covered last, and where in it a pixel of the map is.
  const QuantizedChannels& channels() const { return *channels_; }
  cv::Point inside(cv::Point map_pixel) const { return map_pixel - part_.tl(); }

 private:
  cv::Mat image_, mask_;
  ChannelSet set_;
  ChannelOptions options_;
  cv::Rect part_;
  std::optional<QuantizedChannels> channels_;
};

}  // namespace nadir
