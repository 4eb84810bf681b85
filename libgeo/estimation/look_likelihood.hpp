// How much a look at the map says for its place: the likelihood ratio of a match.
//
// A look is one attempt of the matcher in one window of the map. It yields one candidate, the best place with its
// solved pose, or none. A candidate is either the true place or a chance peak: the best of all places where the frame
// was not taken. With f the features of the match (how distinct the peak is, how well the patches agree, how far the
// solved attitude lies from the telemetry), the evidence for the first against the second is their likelihood ratio
//
//   Λ(f) = p(f | the candidate is the true place) / p(f | the candidate is a chance peak),      ℓ(f) = ln Λ(f).
//
// No other function of f separates the two better: among all tests with the same rate of false acceptance, the one that
// accepts where Λ exceeds a threshold misses least (Neyman & Pearson 1933). ℓ is the weight of evidence in nats (Good,
// "Probability and the Weighing of Evidence", 1950): it is added to the log odds that were there before, and looks at
// different ground add up. A calibrated ratio bounds its own errors: E[Λ | chance] = 1, so by Markov's inequality
//
//   P(Λ > t | chance) <= 1 / t      for every t.
//
// The model is additive and monotone, with N distinct places competing in the window:
//
//   ℓ(f) = b + Σ_j φ_j(f_j) + (ln N - ln N_0) ψ(ratio),      |ℓ| <= c
//
// Every φ_j is piecewise linear and monotone with the sign that physics gives it (a smaller ratio never speaks against
// a place); it is constant beyond its first and last knot. ψ >= 0 falls with the ratio: the same distinct peak says
// more where more places competed. The parameters come from labelled looks by penalised logistic regression: the log
// odds of a logistic classifier, less those of its training set, are the log ratio of the two densities (Platt 1999;
// Bickel et al., "Discriminative learning under covariate shift", 2009). c = ln(chance looks in training / 3): rarer
// events than one in a third of them have not been observed, so no look may claim more (the 95 % bound of zero in n).
//
// The numbers are look_likelihood_table.hpp, written by `./run bench fit-likelihood`, never by hand. How it holds on
// looks that the fit has not seen: docs/look-likelihood.md.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string_view>

#include "vision/map_matcher.hpp"

namespace nadir {

// Deviation of the solved attitude and height from the prediction, in sigmas of the prediction (the larger of both).
double attitude_deviation_sigmas(const SolvedPose& solved, const AnchorPrior& prior);

// What is known of a candidate besides its position. Its order is LookFeatures::names.
struct LookFeatures {
  double ratio = 1;         // best score at any other place over the candidate's, 0 to 1
  double score = 0;         // correlation of all channels at the candidate, at most 1
  double inlier_share = 0;  // patches that agree with the solved pose, of those tried
  double inliers = 0;       // number of those patches
  double residual_px = 0;   // their RMS, in pixels of the fine GSD
  double frame_share = 0;   // of the frame's footprint that they span
  double shift_px = 0;  // ground under the optical axis, between search and solved pose, in pixels of the coarse GSD
  double deviation_sigmas = 0;  // attitude_deviation_sigmas()
  double tilt_sigma_rad = 0;    // of the prior, one axis: the wider, the more poses fit by chance
  double ln_poses = 0;          // ln of the headings and heights tried at every place
  double ln_places = 0;         // ln of the distinct places that competed in the window

  static constexpr std::size_t kCount = 11;
  static constexpr std::array<std::string_view, kCount> names = {
      "ratio",          "score",       "inlier_share", "inliers",
      "residual_px",    "frame_share", "shift_px",     "deviation_sigmas",
      "tilt_sigma_rad", "ln_poses",    "ln_places"};
  std::array<double, kCount> values() const {
    return {ratio,          score,    inlier_share, inliers, residual_px, frame_share, shift_px, deviation_sigmas,
            tilt_sigma_rad, ln_poses, ln_places};
  }
};

// match.solved must be there: without a pose there is no candidate. searched_area_m2: of the camera positions that were
// searched and lie over the map; (2 · radius)² for a whole window. The matcher searches some tens of metres at least.
LookFeatures features_of(const AnchorMatch& match, const AnchorPrior& prior, double searched_area_m2);

// ℓ(f), natural logarithm, within ± the table's limit.
double log_likelihood_ratio(const LookFeatures& features);

// Of a match: as its matcher has judged it, else by its features.
double log_likelihood_ratio(const AnchorMatch& match, const AnchorPrior& prior, double searched_area_m2);

// The summands of ℓ before it is limited: one for each feature, that of ψ, and the constant b, in this order. They say
// why a look counted for much or little.
std::array<double, LookFeatures::kCount + 2> evidence_by_feature(const LookFeatures& features);

// How often a look ends in the true place, or in a pose at all. Shares of the training looks.
struct DetectionRate {
  std::string_view picture;  // clear, old (half of the map has changed), clouds, blur, night
  int looks = 0;             // in windows that hold the place
  double true_place = 0;     // P(the candidate is the true place | the window holds it)
  double other_place = 0;    // P(there is a candidate, and it is another place | the window holds the true one)
};
struct ChanceRate {
  int looks = 0;         // in windows that do not hold the place
  double candidate = 0;  // P(there is a candidate | the window does not hold the place)
};

// ---- The table

struct MonotoneCurve {
  static constexpr std::size_t kMaxKnots = 6;
  int knots = 0;  // used
  std::array<double, kMaxKnots> at{};
  std::array<double, kMaxKnots> value{};  // nats

  double operator()(double x) const;
};

struct LookLikelihoodTable {
  std::string_view training;                               // sets, seeds and worlds of the looks that it was fitted to
  std::string_view training_sha256;                        // of the stored looks, tests/estimation/data/looks.bin
  int true_looks = 0, chance_looks = 0;                    // candidates of either kind
  double limit = 0;                                        // c, nats
  double constant = 0;                                     // b, nats
  double reference_ln_places = 0;                          // ln N_0
  std::array<MonotoneCurve, LookFeatures::kCount> curves;  // φ, in the order of LookFeatures::names
  MonotoneCurve ratio_by_places;                           // ψ, nats for each factor e in places
  std::array<DetectionRate, 5> detection;
  ChanceRate chance;
  std::string_view numbers_sha256;  // of all numbers above: a table that was edited does not match it
};

double log_likelihood_ratio(const LookFeatures& features, const LookLikelihoodTable& table);
// The one in force.
const LookLikelihoodTable& look_likelihood_table();

}  // namespace nadir
