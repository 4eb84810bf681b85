#include "vision/place_matcher.hpp"

namespace nadir {
namespace {

constexpr std::size_t kCachedTiles = 1024;  // 64 MiB in grey, twice that where all have masks

class ChannelMatcher final : public MapMatcher {
 public:
  ChannelMatcher(const MatcherMap& map, const Likeness& likeness)
      : map_(map), reader_(map.tiles, kCachedTiles), likeness_(likeness) {}

  AnchorMatch match(const cv::Mat& grey, const AnchorPrior& prior) override {
    return match_anchor(grey, map_.camera, reader_, map_.frame, prior, map_.surface, likeness_);
  }

  AnchorMatch match_anywhere(const cv::Mat& grey, const AnchorPrior& prior, const PlaneBox& area) override {
    return match_anchor_anywhere(grey, map_.camera, reader_, map_.frame, prior, area, map_.surface, likeness_);
  }

  AnchorMatch match_among(const cv::Mat& grey, const AnchorPrior& prior, const PlaneBox& area,
                          const PlaceSuggestions& suggested) override {
    return match_anchor_among(grey, map_.camera, reader_, map_.frame, prior, area, suggested, map_.surface, likeness_);
  }

 private:
  MatcherMap map_;
  MapWindowReader reader_;  // its tiles serve the next attempt as well
  Likeness likeness_;
};

}  // namespace

std::unique_ptr<MapMatcher> make_channel_matcher(const MatcherMap& map) { return make_channel_matcher_with(map, {}); }

std::unique_ptr<MapMatcher> make_channel_matcher_with(const MatcherMap& map, const Likeness& likeness) {
  return std::make_unique<ChannelMatcher>(map, likeness);
}

}  // namespace nadir
