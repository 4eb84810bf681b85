// Whether an anchor is believed. Rejected means rejected: a refused match never touches the filter.
//
// All thresholds stand here and nowhere else. They come from the knock-out test (tests/bench, docs/safety.md):
// search windows that do not hold the place, where every acceptance is false by definition.
#pragma once

#include "estimation/estimate.hpp"
#include "vision/map_matcher.hpp"

namespace nadir {

struct GateLimits {
  // What a frame shows must stand on two legs: no other place fits as well, and the patches agree on one pose. The
  // weaker the one, the more is asked of the other. Without a prediction two of 1194 wrong places still pass alone.
  double clear_ratio = 0.45;         // below: hardly any other place is thinkable
  double clear_inlier_share = 0.10;  // of the patches tried
  double alone_ratio = 0.80;         // below: the frame may anchor on its own …
  double alone_inlier_share = 0.20;  // … when so many agree
  double vote_ratio = 0.90;          // below: only where a healthy prediction says the same
  double vote_inlier_share = 0.30;
  // Patches that agree by chance are few: then one frame is not enough, unless a sharp prediction says the same (its
  // 95 %), or the ratio is clear in a window where many places compete. By chance they also scatter evenly within the
  // solver's bound, as they do about a pose to which half of a changed map pulls; they lie anywhere in the window; and
  // where the tilt is open, they have two freedoms more to agree in. Where one of that is so, most must agree.
  double sure_inlier_share = 0.40;
  double most_inlier_share = 0.50;
  double max_chance_residual_px = 1.7;
  double expected_chi2 = 5.991;   // 95 % of two degrees of freedom; a frame alone against the start is held to it, too
  double open_tilt_rad = 0.2;     // one sigma of each axis
  double telling_window_m = 200;  // half the side of such a window
  double sharp_sigma_m = 20;
  int min_inliers = 8;
  double min_score = 0.16;        // of all channels at the place
  double min_sharp_score = 0.12;  // where a sharp prediction says the same
  double min_frame_share = 0.25;  // of the frame that the agreeing patches span
  double max_residual_px = 2.5;   // RMS, pixels of the matching GSD
  double max_tilt_sigmas = 4;     // solved tilt and height against what was believed
  double chi2_999 = 13.816;       // two degrees of freedom
  // Against a start that no anchor has confirmed yet: a frame that odometry led to is no picture of another place.
  double chi2_99 = 9.210;
  double healthy_sigma_m = 60;  // a prediction worse than this is no second voice
  // Lost, thousands of places compete and nothing else speaks for the best one: it must stand out further, or be
  // confirmed by others (anchor_votes.hpp).
  double lost_ratio = 0.70;
  double lost_inlier_share = 0.20;
};

struct Prediction {
  double chi2 = 0;  // of the matched position
  double sigma_m = 0;
  bool healthy = false;   // carried without a break from an accepted anchor
  bool lost = false;      // there is none: all of the area, or much of it, was searched
  bool first = false;     // nothing has been anchored yet: there is only a start
  bool followed = false;  // odometry led to this frame from the one before
  bool torn = false;      // the frame does not continue the one before, which should show much of the same ground
};

// How far the solved attitude and height lie from the belief, in sigmas of the belief (the worst of them).
double attitude_surprise(const SolvedPose& solved, const AnchorPrior& prior);

// A sharp prediction says the same as the match.
bool corroborated(const Prediction& prediction, const GateLimits& limits = {});

AnchorVerdict judge_anchor(const AnchorMatch& match, const AnchorPrior& prior, const Prediction& prediction,
                           const GateLimits& limits = {});

}  // namespace nadir
