#include "estimation/belief.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <ranges>
#include <utility>

#include "base/normal_distribution.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {

using namespace parameters::belief;

namespace {

struct Gaussian {
  PlanePoint mean;
  Eigen::Matrix2d covariance_m2;
};

double chi2_of(const Eigen::Vector2d& off, const Eigen::Matrix2d& covariance) {
  return off.dot(covariance.inverse() * off);
}

double density(const Eigen::Vector2d& off, const Eigen::Matrix2d& covariance) {
  return std::exp(-chi2_of(off, covariance) / 2) / (2 * std::numbers::pi * std::sqrt(covariance.determinant()));
}

double normal_between(double low, double high, double mean, double sigma) {
  const auto below = [&](double x) { return normal_share_below((x - mean) / sigma); };
  return below(high) - below(low);
}

// Share of the Gaussian inside the box, with its axes taken for independent.
double inside(const PlaneBox& box, const Gaussian& place) {
  return normal_between(box.west_m, box.east_m, place.mean.east_m, std::sqrt(place.covariance_m2(0, 0))) *
         normal_between(box.south_m, box.north_m, place.mean.north_m, std::sqrt(place.covariance_m2(1, 1)));
}

// Share of the Gaussian so near the candidate that a move to it does no harm.
double share_near(const LookCandidate& candidate, const Gaussian& place) {
  return inside(square_around(candidate.position, kHarmless_m), place);
}

bool same_place(const Eigen::Vector2d& off, const Eigen::Matrix2d& one_m2, const Eigen::Matrix2d& other_m2) {
  return chi2_of(off, one_m2) <= kSamePlace_chi2 && chi2_of(off, other_m2) <= kSamePlace_chi2;
}

// Where the Gaussian is, but for 5 % along each axis.
PlaneBox around(const Gaussian& place) {
  const double east_m = 2 * std::sqrt(place.covariance_m2(0, 0)), north_m = 2 * std::sqrt(place.covariance_m2(1, 1));
  const auto [east, north] = place.mean;
  return {east - east_m, north - north_m, east + east_m, north + north_m};
}

// The second box where they do not meet.
PlaneBox overlap(const PlaneBox& one, const PlaneBox& other) {
  const PlaneBox both{std::max(one.west_m, other.west_m), std::max(one.south_m, other.south_m),
                      std::min(one.east_m, other.east_m), std::min(one.north_m, other.north_m)};
  return both.west_m < both.east_m && both.south_m < both.north_m ? both : other;
}

// Of a miss where the map shows the place: the place was in the window, and the candidate is not it. share: q.
double missed_share(double detection, double share) { return (1 - detection) * share / (1 - detection * share); }

double larger_eigenvalue(const Eigen::Matrix2d& covariance_m2) {
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(covariance_m2, Eigen::EigenvaluesOnly).eigenvalues()[1];
}

}  // namespace

PlaceBelief::PlaceBelief(double track_doubt, const PlaneBox& area)
    : area_(area),
      position_given_(track_doubt < 1),
      detection_hits_(kDetectionHits),
      detection_looks_(kDetectionLooks),
      track_{(1 - track_doubt) * kInitialVisibility, (1 - track_doubt) * (1 - kInitialVisibility)},
      elsewhere_{track_doubt * kInitialVisibility, track_doubt * (1 - kInitialVisibility)} {}

void PlaceBelief::move_weight(Weight& from, Weight& to, double share) {
  to.visible += share * from.visible;
  to.hidden += share * from.hidden;
  from.visible *= 1 - share;
  from.hidden *= 1 - share;
}

void PlaceBelief::propagate(double seconds) {
  const double lost = -std::expm1(-kTrackHazard_per_s * std::abs(seconds));
  const double moved = track_.total() * lost;
  track_.visible *= 1 - lost;
  track_.hidden *= 1 - lost;
  elsewhere_.visible += moved / 2;
  elsewhere_.hidden += moved / 2;
  for (Place& place : places_) {
    if (place.motion_spread == 0) continue;
    const double before_s = std::exchange(place.seconds, place.seconds + std::abs(seconds));
    place.moved_m = place.velocity_mps * std::abs(seconds);
    place.grown_by_m2 = place.velocity_variance * (place.seconds * place.seconds - before_s * before_s);
    place.offset_m += place.moved_m;
    place.covariance_m2 += place.grown_by_m2 * Eigen::Matrix2d::Identity();
  }
}

void PlaceBelief::on_hint(const PlaceHint& hint, const TrackPrediction& track) {
  bring_places_to(track.covariance_m2);
  const Eigen::Matrix2d covariance_m2 = hint.sigma_m * hint.sigma_m * Eigen::Matrix2d::Identity();
  const Eigen::Vector2d offset_m = hint.position - track.position;
  bool says_where = !hinted_;
  const double most = std::exchange(position_given_, true) ? 1 : std::numeric_limits<double>::infinity();
  const auto weigh = [&](Weight& weight, const Eigen::Vector2d& off_m, const Eigen::Matrix2d& of_place_m2) {
    const double here = area_.area_m2() * density(off_m, of_place_m2 + covariance_m2);
    const double likelihood = std::min(most, kHintDoubt + (1 - kHintDoubt) * here);
    weight.visible *= likelihood;
    weight.hidden *= likelihood;
  };
  if (!hinted_) weigh(track_, offset_m, track.covariance_m2);
  for (Place& place : places_) {
    place.contradicts = false;
    if (!hinted_) weigh(place.weight, offset_m - place.offset_m, place.covariance_m2);
    if (place.of_hint) {
      move_weight(place.weight, elsewhere_, 1);
      says_where = true;
    }
  }
  std::erase_if(places_, [](const Place& place) { return place.of_hint; });
  hinted_ = true;
  // A track that is there already gains nothing.
  if (says_where && (track_.total() <= 0 || !same_place(offset_m, covariance_m2, track.covariance_m2))) {
    Place at{{}, offset_m, covariance_m2, track.covariance_m2.trace() / 2};
    at.of_hint = true;
    move_weight(elsewhere_, at.weight, 1 - kHintDoubt);
    add(at);
  }
  normalize();
}

void PlaceBelief::on_odometry(const Eigen::Vector2d& by_m, const Eigen::Matrix2d& covariance_m2) {
  move_track(by_m, covariance_m2, covariance_m2);
}

void PlaceBelief::on_motion(const MotionEvidence& motion, const TrackPrediction& track) {
  const auto unconfirmed = [](const Place& place) { return place.motion_spread > 0; };
  const auto first = std::stable_partition(places_.begin(), places_.end(), std::not_fn(unconfirmed));
  std::vector<Place> settled(first, places_.end());
  places_.erase(first, places_.end());
  for (Place& place : settled) {
    place.offset_m -= place.moved_m;  // it moved as the track did
    place.covariance_m2 -= place.grown_by_m2 * Eigen::Matrix2d::Identity();
    if (motion.spread > 0) {
      const double ratio = motion.spread / place.motion_spread * std::exp(std::min(motion.chi2, kMostMotion_chi2) / 2);
      place.weight.visible *= ratio;
      place.weight.hidden *= ratio;
    }
    place.motion_spread = 0;
    add(place);
  }
  const bool may_be_chance = motion.doubt > kLeastWeight;
  if (may_be_chance) {
    Place at{{}, motion.predicted - track.position, motion.covariance_m2, track.covariance_m2.trace() / 2};
    at.motion_spread = motion.spread;
    at.velocity_mps = motion.velocity_mps;
    at.velocity_variance = motion.velocity_variance;
    move_weight(track_, at.weight, motion.doubt);
    places_.push_back(at);
  }
  if (may_be_chance || !settled.empty()) normalize();
}

void PlaceBelief::on_anchor(const Eigen::Vector2d& by_m, const Eigen::Matrix2d& covariance_before_m2,
                            const Eigen::Matrix2d& covariance_after_m2) {
  move_track(by_m, covariance_before_m2, covariance_after_m2);
}

void PlaceBelief::move_track(const Eigen::Vector2d& by_m, const Eigen::Matrix2d& covariance_before_m2,
                             const Eigen::Matrix2d& covariance_after_m2) {
  for (Place& place : places_) {
    place.offset_m -= by_m;
    place.covariance_m2 = grown_m2(place, covariance_before_m2);
    place.track_variance_m2 = covariance_after_m2.trace() / 2;
  }
}

Eigen::Matrix2d PlaceBelief::grown_m2(const Place& place, const Eigen::Matrix2d& track_covariance_m2) {
  const double grown_m2 = std::max(0.0, track_covariance_m2.trace() / 2 - place.track_variance_m2);
  return place.covariance_m2 + grown_m2 * Eigen::Matrix2d::Identity();
}

bool PlaceBelief::overrules(const Place& place, const Eigen::Matrix2d& track_covariance_m2) const {
  const bool possible = chi2_of(place.offset_m, track_covariance_m2 + place.covariance_m2) <= kChi2_95;
  const bool outdone = place.footprints >= kOverrulingFootprints && track_footprints_ < kOverrulingFootprints;
  return anchored_ && (possible || outdone);
}

// To the frame of a look. A place that hardly differs from the track is the track; a wider one is not, nor is any where
// the track is not known at all.
void PlaceBelief::bring_places_to(const Eigen::Matrix2d& track_covariance_m2) {
  std::erase_if(places_, [&](Place& place) {
    place.covariance_m2 = grown_m2(place, track_covariance_m2);
    place.track_variance_m2 = track_covariance_m2.trace() / 2;
    if (overrules(place, track_covariance_m2)) place.contradicts = false;
    const bool is_wider = place.covariance_m2.trace() > kAlikeVariance * track_covariance_m2.trace();
    const bool is_track = track_.total() > 0 && !place.contradicts && !is_wider &&
                          same_place(place.offset_m, place.covariance_m2, track_covariance_m2);
    if (is_track) move_weight(place.weight, track_, 1);
    return is_track;
  });
}

// The ground changes, or clouds do.
void PlaceBelief::change_visibility(double new_ground) {
  const auto mix = [change = kVisibilityChange * new_ground](Weight& weight) {
    const double moved = change * (weight.visible - kInitialVisibility * weight.total());
    weight.visible -= moved;
    weight.hidden += moved;
  };
  mix(track_);
  mix(elsewhere_);
  for (Place& place : places_) mix(place.weight);
}

PlaceBelief::Detection PlaceBelief::detection(const Look& look, const PlaneBox& place) const {
  const double learned = detection_hits_ / detection_looks_;
  if (!look.detection_odds) return {learned, learned};
  const auto at = [&](const PlanePoint& ground) {
    const double odds = learned / (1 - learned) * look.detection_odds(ground);
    return odds / (1 + odds);
  };
  const PlaneBox seen = overlap(place, look.window);
  double sum = 0;
  for (int row = 0; row < kDetectionSamples; ++row) {
    const double up = (row + 0.5) / kDetectionSamples;
    for (int column = 0; column < kDetectionSamples; ++column) {
      const double right = (column + 0.5) / kDetectionSamples;
      sum += at({seen.west_m + right * (seen.east_m - seen.west_m), seen.south_m + up * (seen.north_m - seen.south_m)});
    }
  }
  const double of_place = sum / (kDetectionSamples * kDetectionSamples);
  return {look.candidate ? at(look.candidate->position) : of_place, of_place};
}

// expected: likelihood ratio of the candidate where the hypothesis expects it, without P_D. share: q.
PlaceBelief::Evidence PlaceBelief::evidence_of(const Look& look, const Detection& detection, double expected,
                                               double share) {
  const double foreign = look.continues_track ? kForeignFrame : kForeignBrokenFrame;
  const double ratio = look.candidate ? std::exp(look.candidate->log_likelihood_ratio) : 0;
  const double elsewhere = foreign * (1 - detection.at_candidate + detection.at_candidate * ratio);
  return {.hit = (1 - foreign) * detection.at_candidate * expected,
          .miss = (1 - foreign) * (1 - detection.of_place * share) + elsewhere,
          .hidden = 1 - foreign + elsewhere};
}

// Returns the weight that is at the candidate from now on.
double PlaceBelief::judge(Weight& weight, const Evidence& look, double new_ground) const {
  const double before = weight.total();
  weight.footprints_since_hit += new_ground;
  if (before <= 0) return 0;
  // No look at this ground has hit it: a share is hit now.
  if (weight.footprints_since_hit >= 1) {
    const double missed = weight.visible * std::pow(look.miss, new_ground);
    weight.visible *=
        std::pow(look.visible(), new_ground) * std::pow(1 + look.hit / (looks_at_ground_ * look.miss), 1 - new_ground);
    weight.hidden *= std::pow(look.hidden, new_ground);
    return weight.visible - missed;
  }
  // What it had of this ground is one look among more. Whether the map still shows the place is a question of this look
  // alone, because it has changed meanwhile (change_visibility()).
  const double visible = weight.visible * look.visible(), hidden = weight.hidden * look.hidden;
  const double kept = (weight.visible * (1 - 1 / looks_at_ground_) + weight.hidden) / before;
  const double after = before * std::pow((visible + hidden) / before, new_ground) * std::pow(kept, 1 - new_ground);
  weight.visible = after * visible / (visible + hidden);
  weight.hidden = after * hidden / (visible + hidden);
  return weight.visible * look.hit / look.visible();
}

LookResult PlaceBelief::update(const Look& look, const TrackPrediction& track) {
  change_visibility(look.new_ground);
  looks_at_ground_ = 1 + (1 - look.new_ground) * looks_at_ground_;
  if (!track.stands) track_footprints_ = 0;
  bring_places_to(track.covariance_m2);

  Weighing weighing = weigh(look, track);
  learn_detection(weighing, look.new_ground);
  LookResult result;
  result.chi2 = weighing.track.candidate.chi2;
  if (look.candidate) {
    std::optional<Place> rival;
    double rival_beside = 0;
    if (look.rival) {
      rival = taken_hits(*look.rival, weighing, &Seen::rival, track);
      const Gaussian there{PlanePoint(track.position.vector() + rival->offset_m), rival->covariance_m2};
      if (!rival->contradicts) rival_beside = rival->weight.total() * share_near(*look.candidate, there);
    }
    Place found = taken_hits(*look.candidate, weighing, &Seen::candidate, track);
    found.footprints += look.new_ground;
    decide(weighing, contradicts_track(weighing.track.candidate, track), rival_beside, result);
    if (result.accepted) {
      result.contradicted = found.contradicted || result.chi2 > kChi2_999;
      move_track_to(found, weighing, track, look.new_ground);
    } else {
      add(found);  // what missed stays where it was, in a place of its own unless it hardly differs
    }
    if (rival) add(*rival);
  }
  normalize();
  return result;
}

// What the look says of each hypothesis.
PlaceBelief::Weighing PlaceBelief::weigh(const Look& look, const TrackPrediction& track) {
  const double window_m2 = look.window.area_m2(), share = std::min(1.0, window_m2 / area_.area_m2());
  const auto ratio_of = [](const std::optional<LookCandidate>& found) {
    return found ? std::exp(found->log_likelihood_ratio) : 0;
  };
  const double ratio = ratio_of(look.candidate), rival_ratio = ratio_of(look.rival);
  // at_candidate, at_rival: likelihood ratios of both where the hypothesis expects them, without P_D. Returns what hit.
  const auto judge_hits = [&](Weight& weight, double at_candidate, double at_rival, const Detection& detected,
                              double in_window, Seen& seen) {
    const Evidence evidence = evidence_of(look, detected, at_candidate + at_rival, in_window);
    const double hits = judge(weight, evidence, look.new_ground);
    seen.rival.weight = at_rival > 0 ? hits * (at_rival / (at_candidate + at_rival)) : 0;
    seen.candidate.weight = hits - seen.rival.weight;
    seen.missed = missed_share(detected.of_place, in_window) * (weight.visible - hits) + seen.rival.weight;
    return hits;
  };
  const auto one = [&](Weight& weight, const Gaussian& place) {
    Seen seen;
    double in_area = inside(area_, place);
    if (in_area < kLeastInArea) in_area = 1;  // one of the two is wrong
    const auto expected = [&](const std::optional<LookCandidate>& found, double its_ratio, Hit& hit) {
      if (!found) return 0.0;
      const Eigen::Vector2d off = found->position - place.mean;
      const Eigen::Matrix2d spread = place.covariance_m2 + found->covariance_m2;
      hit.chi2 = chi2_of(off, spread);
      return its_ratio * window_m2 * density(off, spread) / in_area;
    };
    const double at_candidate = expected(look.candidate, ratio, seen.candidate);
    const double at_rival = expected(look.rival, rival_ratio, seen.rival);
    const double in_window = std::min(1.0, inside(look.window, place) / in_area);
    const double hits = judge_hits(weight, at_candidate, at_rival, detection(look, around(place)), in_window, seen);
    if (look.candidate) seen.beside = (weight.total() - hits) * share_near(*look.candidate, place);
    return seen;
  };
  Weighing weighing;
  weighing.track = one(track_, {track.position, track.covariance_m2});
  for (Place& place : places_) {
    weighing.places.push_back(
        one(place.weight, {PlanePoint(track.position.vector() + place.offset_m), place.covariance_m2}));
  }
  judge_hits(elsewhere_, ratio * share, rival_ratio * share, detection(look, look.window), share, weighing.elsewhere);
  weighing.total = track_.total() + elsewhere_.total();
  for (const Place& place : places_) weighing.total += place.weight.total();
  return weighing;
}

// How often does this camera find the place on this map?
void PlaceBelief::learn_detection(const Weighing& weighing, double new_ground) {
  double found = weighing.track.candidate.weight + weighing.elsewhere.candidate.weight;
  double missed = weighing.track.missed + weighing.elsewhere.missed;
  for (const Seen& seen : weighing.places) {
    found += seen.candidate.weight;
    missed += seen.missed;
  }
  detection_hits_ += new_ground * found / weighing.total;
  detection_looks_ += new_ground * (found + missed) / weighing.total;
}

bool PlaceBelief::contradicts_track(const Hit& of_track, const TrackPrediction& track) const {
  return track.stands && !hinted_ && of_track.chi2 > kChi2_999;
}

void PlaceBelief::share_with_displaced_map(Weighing& weighing, Hit Seen::*at, bool contradicts) {
  const auto share = [&](Seen& seen, Weight& weight) {
    const double shared = kDisplacedMapShare * (seen.*at).weight;
    (seen.*at).weight -= shared;
    weight.visible -= shared;
    track_.hidden += shared;
  };
  if (contradicts) share(weighing.elsewhere, elsewhere_);
  for (std::size_t i = 0; i < places_.size(); ++i) {
    if (places_[i].contradicts) share(weighing.places[i], places_[i].weight);
  }
}

void PlaceBelief::decide(const Weighing& weighing, bool contradicts, double rival_beside, LookResult& result) const {
  double hits = weighing.track.candidate.weight + (contradicts ? 0 : weighing.elsewhere.candidate.weight);
  double beside = weighing.track.beside + rival_beside;
  for (std::size_t i = 0; i < places_.size(); ++i) {
    if (places_[i].contradicts) continue;
    hits += weighing.places[i].candidate.weight;
    beside += weighing.places[i].beside;
  }
  result.place_doubt = std::max(0.0, 1 - (hits + beside) / weighing.total);
  result.association_doubt = hits > 0 ? beside / (hits + beside) : 1;
  result.accepted = result.place_doubt <= kMaxPlaceDoubt && result.association_doubt <= kMaxAssociationDoubt;
}

// What hit the candidate, or its rival, leaves its hypotheses: for the place that it belongs to, as the look has
// measured it, or for a new one.
PlaceBelief::Place PlaceBelief::taken_hits(const LookCandidate& candidate, Weighing& weighing, Hit Seen::*at,
                                           const TrackPrediction& track) {
  const bool contradicts = contradicts_track(weighing.track.*at, track);
  share_with_displaced_map(weighing, at, contradicts);
  const Eigen::Vector2d from_track_m = candidate.position - track.position;
  const double from_track = (weighing.track.*at).weight, from_elsewhere = (weighing.elsewhere.*at).weight;
  std::size_t target = places_.size();
  double most = std::max(from_track, from_elsewhere);
  for (std::size_t i = 0; i < places_.size(); ++i) {
    const Hit& hit = weighing.places[i].*at;
    if (hit.chi2 > kChi2_999 || hit.weight <= most) continue;
    most = hit.weight;
    target = i;
  }
  Place taken{{}, from_track_m, candidate.covariance_m2, track.covariance_m2.trace() / 2, contradicts, contradicts, 0};
  if (target < places_.size()) {
    taken = places_[target];
    taken.of_hint = false;
    measure(taken, from_track_m, candidate.covariance_m2);
  } else if (from_track > from_elsewhere) {
    taken.offset_m.setZero();
    taken.covariance_m2 = track.covariance_m2;
    measure(taken, from_track_m, candidate.covariance_m2);
  }
  taken.weight = {from_track + from_elsewhere, 0, 0};
  track_.visible -= from_track;
  elsewhere_.visible -= from_elsewhere;
  for (std::size_t i = 0; i < places_.size(); ++i) {
    const double from_place = (weighing.places[i].*at).weight;
    taken.weight.visible += from_place;
    places_[i].weight.visible -= from_place;
  }
  return taken;
}

// What is left of the track stays: the candidate was a chance peak, and the track is where it was.
void PlaceBelief::move_track_to(const Place& place, const Weighing& weighing, const TrackPrediction& track,
                                double new_ground) {
  add({track_, Eigen::Vector2d::Zero(), track.covariance_m2, 0, false, false, 0});
  track_ = place.weight;
  track_footprints_ = (weighing.track.candidate.chi2 > kChi2_999 ? 0 : track_footprints_) + new_ground;
  anchored_ = true;
  hinted_ = false;
}

// The candidate is a measurement of where the place is.
void PlaceBelief::measure(Place& place, const Eigen::Vector2d& offset_m, const Eigen::Matrix2d& covariance_m2) {
  const Eigen::Matrix2d gain = place.covariance_m2 * (place.covariance_m2 + covariance_m2).inverse();
  place.offset_m += gain * (offset_m - place.offset_m);
  place.covariance_m2 -= gain * place.covariance_m2;
}

// As one with a place that it hardly differs from.
void PlaceBelief::add(const Place& added) {
  for (Place& place : places_) {
    const Eigen::Vector2d off = added.offset_m - place.offset_m;
    const double all = place.weight.total() + added.weight.total();
    if (place.contradicts != added.contradicts || place.motion_spread > 0 || all <= 0) continue;
    if (!same_place(off, place.covariance_m2, added.covariance_m2)) continue;
    const double share = added.weight.total() / all;
    place.offset_m += share * off;
    place.covariance_m2 =
        (1 - share) * place.covariance_m2 + share * added.covariance_m2 + share * (1 - share) * off * off.transpose();
    place.weight.visible += added.weight.visible;
    place.weight.hidden += added.weight.hidden;
    place.weight.footprints_since_hit = std::min(place.weight.footprints_since_hit, added.weight.footprints_since_hit);
    place.footprints = std::max(place.footprints, added.footprints);
    place.contradicted = place.contradicted || added.contradicted;
    place.of_hint = place.of_hint && added.of_hint;
    return;
  }
  places_.push_back(added);
}

void PlaceBelief::normalize() {
  std::stable_sort(places_.begin(), places_.end(),
                   [](const Place& a, const Place& b) { return a.weight.total() > b.weight.total(); });
  double total = track_.total() + elsewhere_.total();
  for (const Place& place : places_) total += place.weight.total();
  while (!places_.empty() && (places_.size() > kMaxPlaces || places_.back().weight.total() < kLeastWeight * total)) {
    move_weight(places_.back().weight, elsewhere_, 1);
    places_.pop_back();
  }
  const auto scale = [total](Weight& weight) {
    weight.visible /= total;
    weight.hidden /= total;
  };
  scale(track_);
  scale(elsewhere_);
  for (Place& place : places_) scale(place.weight);
}

std::vector<PlaceBelief::PlaceState> PlaceBelief::place_states(const Eigen::Matrix2d& track_covariance_m2) const {
  std::vector<PlaceState> states;
  states.reserve(places_.size());
  for (const Place& p : places_) states.push_back({p.weight.total(), p.offset_m, grown_m2(p, track_covariance_m2)});
  return states;
}

Eigen::Matrix2d PlaceBelief::spread_m2(const Eigen::Matrix2d& track_covariance_m2) const {
  double total = track_.total(), left_out = 0;
  Eigen::Matrix2d spread = track_.total() * track_covariance_m2;
  for (const Place& place : places_ | std::views::reverse) {  // the least first
    left_out += place.weight.total();
    if (left_out <= kVagueWeight) continue;
    total += place.weight.total();
    spread +=
        place.weight.total() * (grown_m2(place, track_covariance_m2) + place.offset_m * place.offset_m.transpose());
  }
  return total > 0 ? Eigen::Matrix2d(spread / total) : track_covariance_m2;
}

std::optional<double> PlaceBelief::protection_level_m(const Eigen::Matrix2d& track_covariance_m2, double risk,
                                                      const Eigen::Matrix2d& common_m2) const {
  struct Component {
    double weight, distance_m, variance_m2;
  };
  std::vector<Component> components{{track_.total(), 0, larger_eigenvalue(track_covariance_m2 + common_m2)}};
  for (const Place& place : places_) {
    components.push_back({place.weight.total(), place.offset_m.norm(),
                          larger_eigenvalue(grown_m2(place, track_covariance_m2) + common_m2)});
  }
  const double left = risk - elsewhere_.total();
  if (left <= 0) return std::nullopt;
  const auto outside = [&](double radius_m) {
    double sum = 0;
    for (const Component& c : components) {
      const double beyond = std::max(0.0, radius_m - c.distance_m);
      sum += c.weight * std::exp(-beyond * beyond / (2 * kTailVarianceFactor * c.variance_m2));
    }
    return sum;
  };
  double low = 0, high = 1;
  while (outside(high) > left) high *= 2;
  for (int i = 0; i < kProtectionLevelBisections; ++i) {
    const double middle = (low + high) / 2;
    (outside(middle) > left ? low : high) = middle;
  }
  return high;
}

}  // namespace nadir
