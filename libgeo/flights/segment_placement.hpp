// Where on the map does a segment as a whole belong, none of whose frames was matched for certain?
//
// A single look may be weak: fields look alike, a season has passed. But the shape of the segment is known
// (segment_shape.hpp), so that one place and one heading say where all of its frames were taken, and weak looks add up.
//
//   search      A few frames, well spread and clear, are searched in an ever larger part of the map: where people say
//               that the segment is, around its predicted place, at the places that the index retrieves, in the whole
//               area part by part. Each place found is a hypothesis: a similarity of the segment.
//   look        At a hypothesis each frame has a predicted place and a small window. The matcher looks there. The best
//               hypothesis is looked at next, until it is settled. A look that hits sharpens the similarity, so that
//               the next window is smaller.
//   decide      by the posterior of all hypotheses and of "somewhere else", as strictly as a flight's belief
//
// Evidence, as in estimation/belief.hpp. A hypothesis begins with the share of what is searched that its first window
// has, W / A, times the share of headings, over the number of frames that were searched: by the union bound this is the
// price of choosing the best-looking place of many. "Somewhere else" has the weight 1, whatever is found. A look in a
// window W around the predicted place x, covariance S, that finds a candidate z with the likelihood ratio ℓ, multiplies
// the odds by
//
//   L = v (P_D ℓ W N(z; x, S + R) + 1 - P_D) + 1 - v          without a candidate: v (1 - P_D) + 1 - v
//
// v: that the map shows the place; P_D: that a place which it shows is found. In the frame that the hypothesis was
// found with, W N = 1: that it agrees with itself is no evidence. Looks that share ground count once: L to the power of
// the share of the footprint that lies away from all frames looked at before.
//
// A placement needs all but belief::kMaxPlaceDoubt of the posterior, two hits, ground of one and a half footprints
// between them, and its rivals looked at as well. Everything is deterministic; step() does one search or one look, so
// that the caller decides how long it works at a time.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string_view>
#include <vector>

#include "base/progress.hpp"
#include "flights/segment_shape.hpp"
#include "geodesy/region.hpp"
#include "vision/ground_surface.hpp"
#include "vision/map_matcher.hpp"

namespace nadir {

// What segments are placed with. All that it refers to must outlive a placement.
struct PlacementMap {
  const CameraFile& camera;  // of the images that `read` returns
  MapMatcher& matcher;
  std::optional<PlaneBox> area;  // where the flight can be at all; nothing: only where it is said or predicted
  const PlaceRetrieval* places = nullptr;
  std::function<cv::Mat(std::size_t frame)> read;  // CV_8UC1; empty: cannot be decoded
};

// Somebody or something says where one of the frames was taken.
struct PlaceStatement {
  std::size_t frame = 0;
  PlanePoint position;
  double reach_m = 0;  // half the side of what is searched around it
};

// What is searched, from the least to the most.
enum class SearchRung { stated, predicted, index, area };
std::string_view name_of(SearchRung rung);

// Of the frame `frame`: where it may have been taken.
struct PlaceCandidateOfFrame {
  std::size_t frame = 0;
  PlanePoint position;
  double heading_rad = 0;  // of image-up
  double likeness = 0;     // of picture and map, 0 to 1: the best score that the search gave it
  double posterior = 0;    // of the whole segment's hypothesis, against the others and "somewhere else"
  double radius_m = 0;     // in which the frame is, should the hypothesis be right
};

struct SegmentPlacementResult {
  // Of all frames of the shape, in its order; empty: the segment stays where it is, floating.
  std::vector<SegmentSimilarity::Pose> poses;
  std::vector<bool> hit;                          // frames whose own look hit, in the same order
  double log_odds = 0;                            // nats, of the best hypothesis against "somewhere else"
  double doubt = 1;                               // posterior of everything else
  std::optional<double> map_ce90_m;               // the worst that the tiles beneath the hits state
  double turn_rad = 0, log_scale = 0;             // of the similarity
  int looks = 0, hits = 0;                        // at the best hypothesis
  std::vector<PlaceCandidateOfFrame> candidates;  // best first, of one frame
};

class SegmentPlacement {
 public:
  // predicted: by dead reckoning, if at all.
  SegmentPlacement(SegmentShape shape, const PlacementMap& map, const std::vector<PlaceStatement>& stated,
                   const std::optional<PlaceStatement>& predicted);
  ~SegmentPlacement();
  SegmentPlacement(const SegmentPlacement&) = delete;
  SegmentPlacement& operator=(const SegmentPlacement&) = delete;

  // Whether looks at this segment could ever place it: it has ground enough.
  static bool possible(const SegmentShape& shape, const CameraModel& camera);

  // One search or look, some tenths of a second. False: there is nothing left to do. Throws Interrupted when cancelled,
  // and can be called again then.
  bool step(const Cancel& cancel = {});
  // Of the searches and looks so far; complete when step() returned false.
  SegmentPlacementResult result() const;
  // What is searched just now, and half the side of its box.
  SearchRung rung() const;
  bool searched_all() const;
  double reach_m() const;
  const SegmentShape& shape() const { return shape_; }

 private:
  struct Hypothesis;
  struct Search;

  void plan_searches(const std::vector<PlaceStatement>& stated, const std::optional<PlaceStatement>& predicted);
  void search(const Search& where, const Cancel& cancel);
  void look(Hypothesis& hypothesis, const Cancel& cancel);
  Hypothesis* next_to_look_at();
  const Hypothesis* best() const;
  double doubt_of(const Hypothesis& hypothesis) const;
  bool accepted(const Hypothesis& hypothesis) const;

  AnchorPrior prior_of(const SegmentSimilarity::Pose& pose, const ShapeFrame& frame, const Cancel& cancel) const;
  double footprint_m(std::size_t index) const;
  const cv::Mat& image(std::size_t index);

  SegmentShape shape_;
  PlacementMap map_;
  std::vector<std::size_t> evidence_;  // indices of frames that are looked at, in order
  std::vector<std::size_t> seeds_;     // of these, that are searched, best first
  std::vector<Search> searches_;       // in the order of their rungs
  std::size_t next_search_ = 0;
  int looks_left_ = 0;  // until the next search
  std::vector<std::unique_ptr<Hypothesis>> hypotheses_;
  std::map<std::size_t, cv::Mat> images_;  // of evidence_, as far as they were read
};

}  // namespace nadir
