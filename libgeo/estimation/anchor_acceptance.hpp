// Whether a match with the map becomes an anchor. A rejected match never touches the filter.
//
// Three parts, and AnchorAcceptance, which joins them:
//   gates                evaluate_anchor(): one match against thresholds and the prediction; the first gate that
//                        rejects names the verdict
//   votes                AnchorVotes: matches that no healthy prediction supports support each other
//   start contradictions StartContradictions: matches that contradict the start, while nothing is anchored
//
// All thresholds: GateLimits and the namespaces anchor_votes, start_contradictions and anchor_measurement of
// localizer_parameters.hpp. Their evidence: docs/safety.md.
#pragma once

#include <Eigen/Core>
#include <deque>
#include <optional>
#include <vector>

#include "estimation/estimate.hpp"
#include "estimation/look_likelihood.hpp"
#include "vision/localizer_parameters.hpp"
#include "vision/map_matcher.hpp"

namespace nadir {

// ---- Gates

// What the filter predicted for the frame that was matched.
struct AnchorPrediction {
  double chi2 = 0;                   // of the matched position, two degrees of freedom
  double sigma_m = 0;                // of the predicted position, one axis
  bool healthy = false;              // propagated without a break from an accepted anchor
  bool lost = false;                 // there is none: all of the area, or much of it, was searched
  bool before_first_anchor = false;  // nothing has been anchored yet: there is only a start
  bool odometry_linked = false;      // odometry tracked from the previous frame to this one
  bool tracking_broken = false;      // the frame does not continue the previous one, although they should overlap
};

// A sharp prediction agrees with the match.
bool corroborated(const AnchorPrediction& prediction, const GateLimits& limits = {});

AnchorVerdict evaluate_anchor(const AnchorMatch& match, const AnchorPrior& prior, const AnchorPrediction& prediction,
                              const GateLimits& limits = {});

// Factor on the solved pose's covariance for what the solver does not model.
double anchor_model_error_factor(bool tilt_missing);

// Variance of one axis of what no model has (lens, relief, the moment of the telemetry); it grows with height.
double unmodelled_variance_m2(double agl_m);

// ---- Votes

// Several frames that independently put the track at the same place are accepted: wrong matches scatter over the whole
// window. More are needed against a track that odometry has propagated from an anchor without a break:
// odometry does not jump, so either that anchor was wrong, or the map is wrong at one of the two places.
struct Quorum {
  int required_votes = parameters::anchor_votes::kVotes;               // of the attempts polled: two more than that
  double agreement_radius_m = parameters::anchor_votes::kAgreement_m;  // between their offsets
  // Least distance between the first and the last of them: frames over the same ground have correlated errors, and
  // however many are taken in a second, they are one vote.
  double min_separation_m = 0;
};

class AnchorVotes {
 public:
  static constexpr int kVotes = parameters::anchor_votes::kVotes;
  static constexpr int kVotesAgainstAnchors = parameters::anchor_votes::kVotesAgainstAnchors;
  static constexpr double kAgreement_m = parameters::anchor_votes::kAgreement_m;

  // In a small window offsets agree by chance: the radius within which less than one random pair in a hundred does.
  static double agreement_radius_m(double window_radius_m);

  // offset_m: matched position minus the one that odometry propagated; at: the latter. True: the quorum
  // agrees with this one.
  bool vote(const Eigen::Vector2d& offset_m, PlanePoint at, const Quorum& quorum);
  void abstain(PlanePoint at);         // an attempt without a plausible match
  void clear() { attempts_.clear(); }  // earlier votes are about another track

 private:
  struct Attempt {
    PlanePoint at;
    std::optional<Eigen::Vector2d> offset_m;  // none: it abstained
  };
  void record(const Attempt& attempt);
  std::vector<Attempt> polled(const Quorum& quorum) const;

  std::deque<Attempt> attempts_;
};

// ---- Start contradictions

// A start that is known to 8 m and a map that puts the first frame 50 m away contradict each other, and one of them is
// wrong. Flying on does not resolve it: the prediction becomes more uncertain, so that the same contradiction,
// propagated by odometry, would look smaller from frame to frame until it passed the gate. A contradiction keeps its
// largest χ².
class StartContradictions {
 public:
  static constexpr double kSamePlace_m = parameters::start_contradictions::kSamePlace_m;
  static constexpr double kDriftSigmas = parameters::start_contradictions::kDriftSigmas;

  // The χ² that a match is tested with: its own, or the largest one recorded at the same place.
  // offset_m: matched minus predicted position (east, north). sigma_m: of the prediction, one axis.
  double effective_chi2(const Eigen::Vector2d& offset_m, double chi2, double sigma_m) const;

  // A match that was rejected, or awaits votes, because it contradicts the start.
  void record(const Eigen::Vector2d& offset_m, double chi2, double sigma_m);

  void clear() { places_.clear(); }  // a first anchor was accepted, or an operator gave a hint

 private:
  struct Place {
    Eigen::Vector2d offset_m;
    double chi2, sigma_m;
    bool same(const Eigen::Vector2d& other_m, double now_sigma_m) const;
  };
  std::vector<Place> places_;  // a few: chance matches are elsewhere each time
};

// ---- All of it

// What the filter knew at the frame that was matched.
struct AnchorContext {
  AnchorPrior prior;
  AnchorPrediction prediction;  // without chi2
  PlanePoint position;          // predicted
  Eigen::Matrix2d position_covariance_m2 = Eigen::Matrix2d::Zero();
  double measured_agl_m = 0;
  double footprint_m = 0;  // longer side
  bool tilt_missing = false;
};

struct AnchorDecision {
  AnchorReport report;
  // The match contradicts the prediction by this much (matched minus predicted): until that is resolved, the published
  // σ must cover both places.
  std::optional<Eigen::Vector2d> contradiction_m;
  // Accepted by votes against the prediction: the position's σ is to be inflated by this before the update.
  std::optional<double> inflate_position_m;
};

class AnchorAcceptance {
 public:
  // start_may_be_overruled: frames that agree with each other overrule the start as they would an anchor.
  AnchorAcceptance(const GateLimits& limits, bool start_may_be_overruled)
      : limits_(limits), start_may_be_overruled_(start_may_be_overruled) {}

  // anchored_before: there is an accepted anchor by now. same_track: odometry has not broken since the frame was taken;
  // otherwise its vote would be about a track that has ended.
  AnchorDecision decide(const AnchorMatch& match, const AnchorContext& context, bool anchored_before, bool same_track);

  void on_track_broken() { votes_.clear(); }
  void on_hint() { start_.clear(); }
  void on_anchor() {
    votes_.clear();
    start_.clear();
  }

 private:
  void count_votes(AnchorDecision& decision, const Eigen::Vector2d& offset_m, const AnchorContext& context,
                   bool anchored_before);

  GateLimits limits_;
  bool start_may_be_overruled_;
  AnchorVotes votes_;
  StartContradictions start_;
};

}  // namespace nadir
