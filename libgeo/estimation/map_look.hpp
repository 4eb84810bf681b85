// One look at the map: what was predicted for the frame, the candidate that the matcher found, and its errors.
#pragma once

#include <Eigen/Core>

#include "estimation/belief.hpp"
#include "estimation/estimate.hpp"
#include "estimation/map_error.hpp"
#include "estimation/pose_measurements.hpp"
#include "vision/map_matcher.hpp"

namespace nadir {

// What was known at the frame that was matched.
struct LookContext {
  AnchorPrior prior;
  TrackPrediction track;
  PlaneBox window;              // camera positions that are searched
  bool lost = false;            // all of the area, or much of it
  bool anchored = false;        // odometry leads on from an anchor without a break
  bool continues_track = true;  // Look's
  double new_ground = 1;        // Look's
  double agl_m = 0;             // measured
  double footprint_m = 0;       // longer side
  bool tilt_missing = false;
};

// Factor on the solved pose's covariance for what the solver does not model.
double anchor_model_error_factor(bool tilt_missing);

// Where few patches agree, those may be the wrong ones: σ of one axis in pixels of the fine map, less the more of them
// agree, down to 0. More have to where ground resembles itself. share: of patches that agree; ratio: second best score
// over the best.
double wrong_consensus_sigma_px(double share, double ratio);
double wrong_consensus_variance_m2(const AnchorMatch& match);

// What is left of that variance where a prediction has its say. That the patches are the wrong ones has the chance
// kWrongConsensusChance, and then the pose is off by a Gaussian of so much more variance; how well either explains the
// distance to the prediction decides between the two (Bayes). A prediction tells them apart as far as it is sharper
// than a wrong consensus is wide: a vague one leaves all of the variance.
//   innovation_m2: predicted and measured covariance together, if the patches are the right ones
double wrong_consensus_left_m2(double variance_m2, const Eigen::Matrix2d& innovation_m2,
                               const Eigen::Vector2d& innovation_m);

// ln ρ: how often the second best place of a window is the true one, over how often the best is, of looks whose patches
// agree at the best. The more alike the two are, the more often. ratio: second best score over the best.
double rival_log_odds(double ratio);

// What the belief needs to know of a match. The rival of its candidate lies where the search found it, and is vaguer by
// what patches make more precise.
Look look_of(const AnchorMatch& match, const LookContext& context);

// What the filter takes of an accepted look. The covariance is larger than the solver's: by what the solver does not
// model; by what anchors over the same ground share (its slope and roofs, the map's own warps: those within a stretch
// count as one, however many frames there were); and, where most patches matched something else, by the chance that
// those which agree are the wrong ones, as far as the filter's prediction does not say otherwise.
//   predicted: the filter's, at the frame; last_anchor: where the one before was matched
PoseMeasurement anchor_measurement(const AnchorMatch& match, const LookContext& context,
                                   const TelemetryReference& reference, const TrackPrediction& predicted,
                                   const std::optional<PlanePoint>& last_anchor);

AnchorReport anchor_report(const AnchorMatch& match, const LookContext& context, const Look& look,
                           const LookResult& result);

}  // namespace nadir
