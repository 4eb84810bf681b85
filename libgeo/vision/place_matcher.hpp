// Where on the map was this frame taken? Backend-neutral: a matcher receives a frame with what is believed of its pose
// and returns the place that fits best, how far it stands out, and the camera's pose with its covariance. Whether that
// is believed is decided by the gates (estimation/anchor_gates.hpp), whoever matched. A learned matcher can stand
// behind the same interface.
//
// What the gates ask of a matcher, whatever it compares:
//   score  1 for a perfect likeness, near 0 for none, seldom above 0.2 at a wrong place
//   ratio  the best likeness anywhere else over the best one: near 1 where the window does not hold the place
//   patches, inliers  what was tried to be found on the map, and how much of it agrees with the solved pose
#pragma once

#include <functional>
#include <memory>

#include "vision/anchor_matcher.hpp"

namespace nadir {

// What a matcher is made for. All of it must outlive the matcher.
struct MatcherMap {
  const CameraModel& camera;
  const TileSource& tiles;
  const LocalFrame& frame;
  const GroundSurface& surface;
};

// One call at a time; not always from the same thread.
class MapMatcher {
 public:
  virtual ~MapMatcher() = default;
  // grey: CV_8UC1 of the camera's size. Searches the window of the prior.
  virtual AnchorMatch match(const cv::Mat& grey, const AnchorPrior& prior) = 0;
  // The same when nothing is known of the position: all of `area` (camera positions, in the map's plane) is searched.
  virtual AnchorMatch match_anywhere(const cv::Mat& grey, const AnchorPrior& prior, const PlaneBox& area) = 0;
  // The same where somebody says where to look first; the ratio is still that of all the area. Who cannot make use of
  // suggestions searches all of it.
  virtual AnchorMatch match_among(const cv::Mat& grey, const AnchorPrior& prior, const PlaneBox& area,
                                  const PlaceSuggestions& /*suggested*/) {
    return match_anywhere(grey, prior, area);
  }
};

using MapMatcherFactory = std::function<std::unique_ptr<MapMatcher>(const MatcherMap&)>;

// Oriented-gradient channels, correlated over the whole window, and patches for the pose.
std::unique_ptr<MapMatcher> make_channel_matcher(const MatcherMap& map);
// The same comparing something else, to show what the channels are worth (./run bench ablations).
std::unique_ptr<MapMatcher> make_channel_matcher_with(const MatcherMap& map, const Likeness& likeness);

// SIFT features of the rectified frame among those of the map, and the place that a robust homography finds most of
// them to agree on. For pictures of one season: across seasons it knows few places again.
std::unique_ptr<MapMatcher> make_sift_matcher(const MatcherMap& map);

}  // namespace nadir
