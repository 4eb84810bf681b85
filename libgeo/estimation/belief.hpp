// Where may the aircraft be? A belief over places, instead of thresholds that a match with the map must pass.
//
// Model. The flight filter tracks one Gaussian, the track: position x, covariance P. It may be wrong as a whole (a
// wrong start, a wrong anchor), and a look at the map may see the wrong place. So there are hypotheses with weights:
//
//   track       the filter is right: N(x, P)
//   place i     the aircraft is at x + o_i, covariance C_i. Found by looks; moves with the track, and grows as it does
//   elsewhere   anywhere in the area, uniformly
//
// and each of them with the map showing the place (visible) or not (hidden: rebuilt, clouds, night, snow). This is
// multiple-hypothesis tracking (Reid 1979) with probabilistic data association (Bar-Shalom and Tse 1975) and a
// perceivable target (Musicki, Evans and Stankovic 1994), where the target stands still and the observer flies.
//
// Look. It searches a window of camera positions (area W) and finds one candidate at z with covariance R, or none. ℓ is
// the likelihood ratio of its features: true place over chance peak (look_likelihood.hpp). Chance peaks lie anywhere
// in the window. So with P_D, the chance that the true place, if it is visible and in the window, is the candidate,
// the likelihood of a hypothesis over that of a chance peak is
//
//   hit  = P_D ℓ W N(z; x_i, C_i + R)        elsewhere: P_D ℓ g, where g is the window's share of the area
//   miss = 1 - P_D q_i                       q_i: share of the hypothesis inside the window
//
// where N and q_i are those of the hypothesis inside the area. Ground may resemble itself: rows of fields, of houses.
// Then the second best place of the window, the rival at z' with R', may be the true one; ℓ' = ρ ℓ, where ρ is how
// often it is, over how often the candidate is, of looks whose two best places are as alike (map_look.hpp).
//
//   hit' = P_D ℓ' W N(z'; x_i, C_i + R')
//   L_visible = hit + hit' + miss,  L_hidden = 1
// P_D is the mean of a beta distribution: how often a place is found differs from ground to ground and from camera to
// camera (the prior, from measured looks), and a flight learns its own from the weights of its looks. Where the map is
// known to be matched well or badly, its odds have a factor. In hit it is that of the ground at z, because the place is
// there; in miss the mean over the hypothesis in the window, because the place may be anywhere in it.
//
// With the chance p_f that the frame is not of this moment (a mixed-up recording): L ← (1 - p_f) L + p_f (1 - P_D + P_D
// ℓ). Weights are multiplied by L; of a visible hypothesis the share hit / L is at z from now on, and hit' / L at z'.
//
// The same ground is one witness. s is the share of ground that the last look did not show: for it weights are
// multiplied by L^s. Of n looks at the same ground the mean of L counts, because the mean of likelihood ratios is
// one, however they depend on each other (Vovk and Wang 2021). It is kept apart by the look that hit: what a look hit
// before has 1 - 1/n of its weight left, and of what none has hit yet hit / n is at the candidate from now on, both to
// the power of 1 - s.
//
// A displaced map cannot be distinguished from a wrong track by looking at that map. So a place that contradicts a
// track which nothing else contradicts (a start that was given; odometry that leads on from an anchor without a break)
// does not move it, and a share of what hits it stays with the track, over a displaced map: the level holds both, and
// where the map is right again so is the track. An anchored track ends this when it has grown so uncertain that the
// place is inside its 95 % ellipse; or when kOverrulingFootprints of ground support the place, where fewer supported
// the track since it last moved against its own prediction. So few may be an accident of the matcher, so many are none:
// where both have them a map is displaced, here or there.
//
// Decision. The track moves to z when all but kMaxPlaceDoubt of the weight is there: hits, and what lies within
// kHarmless_m of z, where the next look searches as well; and when z is then no chance peak beside the truth but for
// kMaxAssociationDoubt. By what remains of that doubt the filter weighs z (weighted_by_association(),
// pose_measurements.hpp). What is left of the track stays where it was, as a place. Otherwise z becomes a place, and
// nothing is moved. z' never moves the track, because no pose was solved there: it becomes a place. A place that comes
// to lie where the track is, and is hardly wider, becomes the track.
//
// Unconfirmed motion. Few pixels of two frames may agree on a motion by chance; with the chance b (tracking_state.hpp)
// the track did not move as odometry says. So much of the track becomes a place where the track was predicted without
// that motion, with the covariance of the prediction. While no further motion is measured it goes on with the velocity
// that was predicted, as uncertain as it was. The next motion that is taken is explained by both: by the track, with
// the density exp(-χ²/2) / s, and by this place with at most 1 / s₀, s being the volume of the prediction's spread then
// and now. Where chance found one motion it hardly finds the next one beside it.
//
// Hint. Someone says where the aircraft is, h ± σ, and is wrong as a whole with the chance d. Over a statement that
// says nothing (uniform in the area A) its likelihood is
//   L = d + (1 - d) A N(h; x_i, C_i + σ²)
// and at most 1 after a start or another hint, because it may repeat them. Of elsewhere all but d is a place at h.
// Until the track moves further hints of several move that place, if no look has hit it, and say nothing more.
//
// Protection level. The least radius around the published position that holds all but the integrity risk of the whole
// mixture. A Gaussian with the larger eigenvalue σ² of its covariance, at a distance o, is outside r with at most
//   exp(-(r - o)² / 2 κ σ²)
// with κ = 1. The errors of true places have heavier tails, which κ = kTailVarianceFactor covers. None when more than
// the risk is elsewhere.
//
// Numbers: namespace belief of localizer_parameters.hpp.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <vector>

#include "geodesy/plane_point.hpp"
#include "geodesy/region.hpp"

namespace nadir {

// The flight filter's prediction for the frame that was matched.
struct TrackPrediction {
  PlanePoint position;
  Eigen::Matrix2d covariance_m2 = Eigen::Matrix2d::Zero();
  bool stands = false;  // nothing but the map contradicts it: a start that was given, or odometry without a break
};

struct LookCandidate {
  PlanePoint position;
  Eigen::Matrix2d covariance_m2 = Eigen::Matrix2d::Zero();
  double log_likelihood_ratio = 0;  // ln ℓ
};

struct Look {
  PlaneBox window;  // camera positions that were searched
  std::optional<LookCandidate> candidate;
  double new_ground = 1;        // s
  bool continues_track = true;  // false: the frame and the previous one should overlap, and do not
  // Factor on the odds of P_D of the ground beneath a camera, above 0, by its matchability; empty: 1 everywhere.
  std::function<double(const PlanePoint&)> detection_odds{};
  std::optional<LookCandidate> rival{};  // the second best place, beside a candidate
};

// A motion that odometry measured, and the track took.
struct MotionEvidence {
  double spread = 0;  // s, √|S| of the innovation, m² rad; 0: unknown, and then it says nothing of earlier ones
  double chi2 = 0;    // three degrees of freedom
  // For one that may be chance:
  double doubt = 0;                                         // b
  PlanePoint predicted{};                                   // without it …
  Eigen::Matrix2d covariance_m2 = Eigen::Matrix2d::Zero();  // … and how surely
  Eigen::Vector2d velocity_mps = Eigen::Vector2d::Zero();   // without it, from the track's with it …
  double velocity_variance = 0;                             // … and how surely, (m/s)², one axis
};

// One axis.
struct PlaceHint {
  PlanePoint position;
  double sigma_m = 0;
};

struct LookResult {
  bool accepted = false;         // the track moves to the candidate
  double chi2 = 0;               // of the candidate against the track, two degrees of freedom
  double place_doubt = 1;        // weight that is not at the candidate
  double association_doubt = 1;  // chance that it is a chance peak beside the truth
  // The track moves to a place that contradicts it, or did when a look first found it. Then its past is wrong, and how
  // far it moves says nothing about odometry.
  bool contradicted = false;
};

class PlaceBelief {
 public:
  // track_doubt: chance that the track is wrong as a whole at the beginning; 1: it is not known at all.
  // area: where the aircraft is in any case. What a hypothesis has beyond it does not count.
  PlaceBelief(double track_doubt, const PlaneBox& area);

  // Time passes, during which the track may have become wrong without a sign.
  void propagate(double seconds);
  LookResult update(const Look& look, const TrackPrediction& track);
  // Odometry has measured how the aircraft moved, which is what every place did too: they grow as the track has grown
  // since. by_m: of the track's past, by what odometry says of earlier displacements. Places stay where they are.
  void on_odometry(const Eigen::Vector2d& by_m, const Eigen::Matrix2d& covariance_m2);
  // After on_odometry().
  void on_motion(const MotionEvidence& motion, const TrackPrediction& track);
  // The filter has moved the track to an accepted candidate. Places stay where they are, and as wide.
  void on_anchor(const Eigen::Vector2d& by_m, const Eigen::Matrix2d& covariance_before_m2,
                 const Eigen::Matrix2d& covariance_after_m2);
  // Places that contradict the track count in full from now on, until it moves.
  void on_hint(const PlaceHint& hint, const TrackPrediction& track);

  // Second moment about the track's position: of the track and the places, without elsewhere and without the least
  // places, up to kVagueWeight together.
  Eigen::Matrix2d spread_m2(const Eigen::Matrix2d& track_covariance_m2) const;
  // Nothing: no radius holds all but the risk. common_m2 is added to every place's covariance (the map's own error).
  std::optional<double> protection_level_m(const Eigen::Matrix2d& track_covariance_m2, double risk,
                                           const Eigen::Matrix2d& common_m2) const;

  double track_probability() const { return track_.total(); }
  double elsewhere_probability() const { return elsewhere_.total(); }
  std::size_t places() const { return places_.size(); }

  // For those who judge a belief: every place as it is now.
  struct PlaceState {
    double probability = 0;
    Eigen::Vector2d offset_m;  // from the track
    Eigen::Matrix2d covariance_m2;
  };
  std::vector<PlaceState> place_states(const Eigen::Matrix2d& track_covariance_m2) const;

 private:
  struct Weight {
    double visible = 0, hidden = 0;
    double footprints_since_hit = 1;  // of ground since a look hit it
    double total() const { return visible + hidden; }
  };
  // What a look says of one hypothesis: L = hit + miss where the map shows the place, hidden where it does not.
  struct Evidence {
    double hit = 0, miss = 1, hidden = 1;
    double visible() const { return hit + miss; }
  };
  struct Place {
    Weight weight;
    Eigen::Vector2d offset_m;       // from the track
    Eigen::Matrix2d covariance_m2;  // when it was last seen …
    double track_variance_m2;       // … and the track's then
    bool contradicted = false;      // a track that stood, when a look found it
    bool contradicts = false;       // does so: does not move the track
    double footprints = 0;          // of ground that supported it
    bool of_hint = false;           // no look has hit it
    // Of the last one, until the next one; 0 for others.
    double motion_spread = 0;
    Eigen::Vector2d velocity_mps = Eigen::Vector2d::Zero();  // from the track's
    double velocity_variance = 0, seconds = 0;               // one axis; since then
    // By these it has moved and grown since the last frame, if no motion of this one is measured.
    Eigen::Vector2d moved_m = Eigen::Vector2d::Zero();
    double grown_by_m2 = 0;
  };
  // As the track's covariance has grown since.
  static Eigen::Matrix2d grown_m2(const Place& place, const Eigen::Matrix2d& track_covariance_m2);
  // P_D at the candidate, and its mean over a hypothesis in the window.
  struct Detection {
    double at_candidate, of_place;
  };
  Detection detection(const Look& look, const PlaneBox& place) const;
  static Evidence evidence_of(const Look& look, const Detection& detection, double expected, double share);
  // Weight of a hypothesis that is at the candidate, or at its rival, from now on.
  struct Hit {
    double weight = 0;
    double chi2 = 0;  // of the candidate
  };
  // Weights of a hypothesis after a look.
  struct Seen {
    Hit candidate, rival;
    double missed = 0;  // the map shows it in the window, and the candidate is not it
    double beside = 0;  // hit neither, and so near the candidate that a move to it does no harm
  };
  struct Weighing {
    Seen track, elsewhere;
    std::vector<Seen> places;
    double total = 0;  // of all weights
  };

  // The steps of update(), in order.
  void change_visibility(double new_ground);
  void bring_places_to(const Eigen::Matrix2d& track_covariance_m2);
  Weighing weigh(const Look& look, const TrackPrediction& track);
  void learn_detection(const Weighing& weighing, double new_ground);
  bool contradicts_track(const Hit& of_track, const TrackPrediction& track) const;
  void share_with_displaced_map(Weighing& weighing, Hit Seen::*at, bool contradicts);
  void decide(const Weighing& weighing, bool contradicts, double rival_beside, LookResult& result) const;
  Place taken_hits(const LookCandidate& candidate, Weighing& weighing, Hit Seen::*at, const TrackPrediction& track);
  void move_track_to(const Place& place, const Weighing& weighing, const TrackPrediction& track, double new_ground);
  void normalize();

  // An anchored track, and a place that contradicts it: the track may be there, or more ground supports the place.
  bool overrules(const Place& place, const Eigen::Matrix2d& track_covariance_m2) const;
  static void move_weight(Weight& from, Weight& to, double share);
  double judge(Weight& weight, const Evidence& look, double new_ground) const;
  void move_track(const Eigen::Vector2d& by_m, const Eigen::Matrix2d& covariance_before_m2,
                  const Eigen::Matrix2d& covariance_after_m2);
  static void measure(Place& place, const Eigen::Vector2d& offset_m, const Eigen::Matrix2d& covariance_m2);
  void add(const Place& added);

  PlaneBox area_;
  bool position_given_;          // a start, or a hint
  bool anchored_ = false;        // the track has moved to a candidate
  double track_footprints_ = 0;  // of ground that supported it since it last broke, or moved against its prediction
  double looks_at_ground_ = 0;   // at what the last frame showed
  bool hinted_ = false;          // since the last anchor
  // P_D = hits / looks at ground that the map shows, with those of the prior.
  double detection_hits_, detection_looks_;
  Weight track_, elsewhere_;
  std::vector<Place> places_;
};

}  // namespace nadir
