// Where on the map was this frame taken? Backend-neutral: a matcher receives a frame with what is known of its pose and
// returns the hypothesis that fits best, how distinctive it is, and the camera's pose with its covariance. Whether that
// is accepted is decided by estimation, for any matcher. A learned matcher can implement the same interface.
//
// What the acceptance expects of a matcher, whatever it compares:
//   score  1 for a perfect match, near 0 for none, seldom above 0.2 at a wrong place
//   ratio  the best score anywhere else over the best one: near 1 where the window does not contain the place
//   patches, inliers  what was searched on the map, and how much of it agrees with the solved pose
#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <optional>

#include "geodesy/local_frame.hpp"
#include "geodesy/region.hpp"
#include "imagery/map_window.hpp"
#include "vision/camera_pose_solver.hpp"
#include "vision/map_search.hpp"

namespace nadir {

struct AnchorMatch;

struct AnchorPrior {
  SearchPrior search;
  double heading_sigma_rad = kAnchorHeadingSigma_rad;
  double log_agl_sigma = kAnchorLogAglSigma;
  Eigen::Matrix2d tilt_covariance_rad2 = Eigen::Matrix2d::Identity() * kAnchorTiltVariance_rad2;  // pitch, roll
  // Whether this match would settle where the aircraft is if its ln Λ were so: then a second matcher need not look
  // (estimation/second_opinion.hpp). Empty: nobody knows.
  std::function<bool(const AnchorMatch& match, double log_likelihood_ratio)> settles{};
  Cancel cancel;  // not a prior: ends the attempt by Interrupted, because a search may last half a minute
};

struct AnchorMatch {
  SearchResult search;
  std::optional<SolvedPose> solved;
  int patches = 0;         // tried in the last round
  double frame_share = 0;  // share of the frame's footprint that the agreeing patches span
  double fine_gsd_m = 0;   // that the patches were matched at
  double coarse_gsd_m = 0;
  bool on_map = true;  // false: the window holds no map
  // The worst CE90 that the tiles beneath the solved pose's footprint state; nothing where none states any.
  std::optional<double> map_ce90_m;
  // ln of the likelihood ratio of true place over chance peak, where the matcher knows it by a table of its own.
  // Nothing: it follows from the features above (estimation/look_likelihood.hpp).
  std::optional<double> judged_log_likelihood_ratio;
  cv::Mat rectified;  // grey, as matched in the last round
  cv::Mat matched_map;
};

// Where to look first; what is found there must be distinctive in the whole area all the same.
struct SearchSuggestions {
  std::optional<PlaneBox> hint;               // camera positions that an operator names
  const PlaceRetrieval* retrieval = nullptr;  // retrieves places that look similar
};

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
  // The same when nothing is known of the position: all of `area` (camera positions, in the map's plane) is searched,
  // and the ratio compares the best hypothesis with the best one anywhere else in it. The prior's position is not used.
  virtual AnchorMatch match_anywhere(const cv::Mat& grey, const AnchorPrior& prior, const PlaneBox& area) = 0;
  // The same, but searches only where it is suggested. What is found there is compared with the whole area, under its
  // own heading and height: the ratio means the same, and a suggestion cannot make a place look unique. A matcher that
  // cannot use suggestions searches all of the area.
  virtual AnchorMatch match_among(const cv::Mat& grey, const AnchorPrior& prior, const PlaneBox& area,
                                  const SearchSuggestions& /*suggested*/) {
    return match_anywhere(grey, prior, area);
  }
};

using MapMatcherFactory = std::function<std::unique_ptr<MapMatcher>(const MatcherMap&)>;

// Oriented-gradient channels, correlated over the whole window, and patches for the pose. Keeps the tiles that it
// decoded, so that attempts over the same ground are cheap; that changes no result.
std::unique_ptr<MapMatcher> make_channel_matcher(const MatcherMap& map);
// The same with other features, to measure the value of the channels (./run bench ablations).
std::unique_ptr<MapMatcher> make_channel_matcher_with(const MatcherMap& map, const MatchFeatures& features);

}  // namespace nadir
