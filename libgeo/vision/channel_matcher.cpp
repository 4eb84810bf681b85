#include "vision/place_matcher.hpp"

namespace nadir {
namespace {

class ChannelMatcher final : public PlaceMatcher {
 public:
  ChannelMatcher(const MatcherMap& map, const Likeness& likeness) : map_(map), likeness_(likeness) {}

  AnchorMatch match(const cv::Mat& grey, const AnchorPrior& prior) override {
    return match_anchor(grey, map_.camera, map_.tiles, map_.frame, prior, map_.surface, likeness_);
  }

  AnchorMatch match_anywhere(const cv::Mat& grey, const AnchorPrior& prior, const PlaneBox& area) override {
    return match_anchor_anywhere(grey, map_.camera, map_.tiles, map_.frame, prior, area, map_.surface, likeness_);
  }

 private:
  MatcherMap map_;
  Likeness likeness_;
};

}  // namespace

std::unique_ptr<PlaceMatcher> make_channel_matcher(const MatcherMap& map) { return make_channel_matcher_with(map, {}); }

std::unique_ptr<PlaceMatcher> make_channel_matcher_with(const MatcherMap& map, const Likeness& likeness) {
  return std::make_unique<ChannelMatcher>(map, likeness);
}

}  // namespace nadir
