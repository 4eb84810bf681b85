#include "vision/map_channels.hpp"

#include <utility>

namespace nadir {

namespace {

constexpr int kRoom_px = 12;  // what is asked for next often lies a little beside

}  // namespace

MapChannels::MapChannels(cv::Mat image, cv::Mat mask, ChannelSet set, const ChannelOptions& options)
    : image_(std::move(image)), mask_(std::move(mask)), set_(set), options_(options) {}

void MapChannels::cover(const cv::Rect& part) {
  if (channels_ && (part & part_) == part) return;
  part_ = {part.x - kRoom_px, part.y - kRoom_px, part.width + 2 * kRoom_px, part.height + 2 * kRoom_px};
  const cv::Rect available = part_ & cv::Rect(cv::Point(), map_size());
  cv::Mat image(part_.size(), CV_8UC1, cv::Scalar(0)), mask(part_.size(), CV_8UC1, cv::Scalar(0));
  if (!available.empty()) {
    image_(available).copyTo(image(available - part_.tl()));
    mask_(available).copyTo(mask(available - part_.tl()));
  }
  channels_.emplace(oriented_channels(image, mask, set_, options_));
}

}  // namespace nadir
