#include "flights/segment_placement.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "estimation/look_likelihood.hpp"
#include "estimation/map_look.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/hypotenuse.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {
namespace {

namespace belief = parameters::belief;

// Chosen, all of them; what counts as evidence is the localizer's own (localizer_parameters.hpp).
constexpr std::size_t kEvidenceFrames = 8;  // of a segment, that are looked at
constexpr std::size_t kSeedFrames = 2;      // of these, that are searched
constexpr int kLooksOfSeed = 24;            // at all hypotheses: bounds the time
constexpr std::size_t kHypotheses = 40;     // of a segment: likewise
constexpr std::size_t kMaxParts = 16;       // of the area, of each seed: likewise
constexpr int kLeastHits = 2;
constexpr double kLeastFootprints = 1.5;           // of ground that the hits show
constexpr std::size_t kRivals = 4;                 // hypotheses beside the best one that are looked at …
constexpr std::size_t kRivalLooks = 2;             // … in so many frames
constexpr double kHopeless = 2.5;                  // nats lost to misses: such a hypothesis is not looked at any more
constexpr double kWindow_m = 60;                   // half the least side of a look's window, as the localizer's
constexpr double kWindowSigmas = 3;                // half the side in σ of the predicted place
constexpr double kFoundSigma_m = 15;               // of a place that a search found, one axis; before its own look
constexpr double kFoundTurn_rad = radians(4);      // half the range of headings around the one that a search found
constexpr double kTurnOfFrame_rad = radians(1.5);  // of one frame's heading against the segment's, 1-σ
constexpr double kHeadingSigmas = 3;
constexpr double kScaleSigmas = 2.5;
constexpr double kLeastHeadingSigma_rad = radians(1);
constexpr double kMeasuredTurn_rad = radians(20);  // headings better known than this: few are searched
constexpr double kPart_m = 1600;                   // side of a part of the area with measured headings …
constexpr double kPartAnyHeading_m = 500;          // … and without: the time of a search
constexpr double kLargestPredicted_m = 1200;       // a prediction that is worse is none
constexpr double kSamePlace_m = 40;                // two hypotheses that mean the same …
constexpr double kSameTurn_rad = radians(10);      // … likewise
constexpr std::size_t kCandidates = 5;             // that a person is asked about
constexpr double kCandidateSigmas = 2;             // of their radius
constexpr double kLeastCandidateRadius_m = 50;

double square(double value) { return value * value; }

PlaneBox within(const PlaneBox& box, const std::optional<PlaneBox>& area) {
  if (!area) return box;
  return {std::max(box.west_m, area->west_m), std::max(box.south_m, area->south_m), std::min(box.east_m, area->east_m),
          std::min(box.north_m, area->north_m)};
}

bool is_empty(const PlaneBox& box) { return !(box.west_m < box.east_m && box.south_m < box.north_m); }

double half_side_m(const PlaneBox& box) { return std::max(box.east_m - box.west_m, box.north_m - box.south_m) / 2; }

// Nearest to `from` first.
std::vector<PlaneBox> parts_of(const PlaneBox& area, double side_m, PlanePoint from) {
  const auto count = [side_m](double way_m) { return std::max(1, static_cast<int>(std::ceil(way_m / side_m))); };
  const double east_m = area.east_m - area.west_m, north_m = area.north_m - area.south_m;
  const int columns = count(east_m), rows = count(north_m);
  std::vector<PlaneBox> parts;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      parts.push_back({area.west_m + column * east_m / columns, area.south_m + row * north_m / rows,
                       area.west_m + (column + 1) * east_m / columns, area.south_m + (row + 1) * north_m / rows});
    }
  }
  std::stable_sort(parts.begin(), parts.end(), [&](const PlaneBox& a, const PlaneBox& b) {
    return distance_m(a.middle(), from) < distance_m(b.middle(), from);
  });
  return parts;
}

// Of each of so many equal stretches of the way the frame whose look in flight said most.
std::vector<std::size_t> spread_frames(const SegmentShape& shape, std::size_t count) {
  std::vector<double> way_m(shape.frames.size(), 0);
  for (std::size_t i = 1; i < way_m.size(); ++i) {
    way_m[i] = way_m[i - 1] + (shape.frames[i].offset_m - shape.frames[i - 1].offset_m).norm();
  }
  const double stretch_m = std::max(1e-6, way_m.back() / static_cast<double>(count));
  std::vector<std::optional<std::size_t>> chosen(count);
  for (std::size_t i = 0; i < way_m.size(); ++i) {
    if (!shape.frames[i].usable) continue;
    auto& best = chosen[std::min(count - 1, static_cast<std::size_t>(way_m[i] / stretch_m))];
    if (!best || shape.frames[i].evidence > shape.frames[*best].evidence) best = i;
  }
  std::vector<std::size_t> frames;
  for (const auto& each : chosen) {
    if (each) frames.push_back(*each);
  }
  return frames;
}

// The part of a position's covariance that the error of the measured tilt causes: with C the covariance of position and
// tilt, and Σ that of the tilt as measured, C Σ⁻¹ Cᵀ.
Eigen::Matrix2d tilt_covariance_m2(const SolvedPose& solved, const Eigen::Matrix2d& tilt_covariance_rad2) {
  const Eigen::Matrix2d with_tilt = solved.covariance.block<2, 2>(0, 4);
  return with_tilt * tilt_covariance_rad2.inverse() * with_tilt.transpose();
}

double gaussian(const Eigen::Vector2d& off_m, const Eigen::Matrix2d& covariance_m2) {
  return std::exp(-off_m.dot(covariance_m2.inverse() * off_m) / 2) /
         (2 * std::numbers::pi * std::sqrt(covariance_m2.determinant()));
}

}  // namespace

std::string_view name_of(SearchRung rung) {
  switch (rung) {
    case SearchRung::stated: return "stated";
    case SearchRung::predicted: return "predicted";
    case SearchRung::index: return "index";
    case SearchRung::area: return "area";
  }
  return {};
}

struct SegmentPlacement::Search {
  SearchRung rung = SearchRung::area;
  std::size_t seed = 0;    // index in the shape
  PlaneBox box{};          // camera positions of the seed's frame
  double searched_m2 = 0;  // by all searches of this rung
  double shared_by = 1;    // frames that are searched in this rung

  bool goes_on(const Search& before) const { return rung == before.rung && seed == before.seed; }
};

struct SegmentPlacement::Hypothesis {
  Hypothesis(const SegmentShape& shape, const SegmentSimilarity::Prior& prior) : similarity(shape, prior) {}

  SegmentSimilarity similarity;
  std::size_t seed = 0;
  double likeness = 0;
  double log_odds = 0;              // against "somewhere else"
  double begun_with = 0;            // of that
  std::vector<std::size_t> left;    // indices to be looked at, the next one last
  std::vector<std::size_t> looked;  // indices that were
  int hits = 0;
  std::optional<double> map_ce90_m;  // of the hits, the worst
  double footprints = 0;             // of ground that the hits show

  bool hopeless() const { return log_odds < begun_with - kHopeless; }
  bool settled() const { return left.empty() || hopeless(); }
};

SegmentPlacement::SegmentPlacement(SegmentShape shape, const PlacementMap& map,
                                   const std::vector<PlaceStatement>& stated,
                                   const std::optional<PlaceStatement>& predicted)
    : shape_(std::move(shape)), map_(map) {
  if (!possible(shape_, map_.camera.camera)) return;
  evidence_ = spread_frames(shape_, kEvidenceFrames);
  seeds_ = evidence_;
  std::stable_sort(seeds_.begin(), seeds_.end(),
                   [&](std::size_t a, std::size_t b) { return shape_.frames[a].evidence > shape_.frames[b].evidence; });
  if (seeds_.size() > kSeedFrames) seeds_.resize(kSeedFrames);
  plan_searches(stated, predicted);
}

SegmentPlacement::~SegmentPlacement() = default;

bool SegmentPlacement::possible(const SegmentShape& shape, const CameraModel& camera) {
  if (shape.frames.empty()) return false;
  double footprint_m = 0, reach_m = 0;
  int usable = 0;
  const ShapeFrame* first = nullptr;
  for (const ShapeFrame& frame : shape.frames) {
    if (!frame.usable) continue;
    ++usable;
    footprint_m = std::max(footprint_m, footprint_side_m(camera, frame.agl_m));
    if (first == nullptr) first = &frame;
    reach_m = std::max(reach_m, (frame.offset_m - first->offset_m).norm());
  }
  return usable >= kLeastHits && reach_m >= (kLeastFootprints - 1) * footprint_m;
}

// Every search of a rung costs its hypotheses alike: what the rung has searched in all, shared by its seeds.
void SegmentPlacement::plan_searches(const std::vector<PlaceStatement>& stated,
                                     const std::optional<PlaceStatement>& predicted) {
  const auto add = [this](SearchRung rung, const std::vector<std::pair<std::size_t, PlaneBox>>& where,
                          double searched_m2, std::size_t seeds) {
    for (const auto& [seed, box] : where) {
      searches_.push_back({rung, seed, box, searched_m2, static_cast<double>(std::max<std::size_t>(1, seeds))});
    }
  };
  const auto index_of = [this](std::size_t frame) {
    std::size_t nearest = 0;
    for (std::size_t i = 0; i < shape_.frames.size(); ++i) {
      const auto off = [&](std::size_t at) {
        const std::size_t other = shape_.frames[at].frame;
        return other > frame ? other - frame : frame - other;
      };
      if (off(i) < off(nearest)) nearest = i;
    }
    return nearest;
  };
  // Around where a frame is said to be: the seeds lie as far from it as the shape says, whatever its heading.
  const auto around = [&](const PlaceStatement& statement, std::size_t seed) {
    const Eigen::Vector2d way_m = shape_.frames[seed].offset_m - shape_.frames[index_of(statement.frame)].offset_m;
    const bool turned = shape_.turn_sigma_rad > kMeasuredTurn_rad;
    const PlanePoint middle = turned ? statement.position : statement.position + way_m;
    const double reach_m =
        statement.reach_m + (turned ? way_m.norm() : kHeadingSigmas * shape_.turn_sigma_rad * way_m.norm());
    return within(square_around(middle, std::max(reach_m, kWindow_m)), map_.area);
  };
  std::vector<std::pair<std::size_t, PlaneBox>> boxes;
  double searched_m2 = 0;
  for (const PlaceStatement& statement : stated) {
    for (const std::size_t seed : seeds_) {
      const PlaneBox box = around(statement, seed);
      if (is_empty(box)) continue;
      boxes.emplace_back(seed, box);
      searched_m2 += box.area_m2() / static_cast<double>(seeds_.size());
    }
  }
  add(SearchRung::stated, boxes, searched_m2, seeds_.size());
  boxes.clear();
  if (predicted && predicted->reach_m <= kLargestPredicted_m) {
    searched_m2 = 0;
    for (const std::size_t seed : seeds_) {
      const PlaneBox box = around(*predicted, seed);
      if (is_empty(box)) continue;
      boxes.emplace_back(seed, box);
      searched_m2 = std::max(searched_m2, box.area_m2());
    }
    add(SearchRung::predicted, boxes, searched_m2, seeds_.size());
  }
  if (!map_.area) return;
  const double area_m2 = map_.area->area_m2();
  boxes.clear();
  for (const std::size_t seed : seeds_) boxes.emplace_back(seed, *map_.area);
  if (map_.places != nullptr) add(SearchRung::index, boxes, area_m2, seeds_.size());
  const double side_m = shape_.turn_sigma_rad > kMeasuredTurn_rad ? kPartAnyHeading_m : kPart_m;
  std::vector<PlaneBox> parts = parts_of(*map_.area, side_m, predicted ? predicted->position : map_.area->middle());
  if (parts.size() > kMaxParts) parts.resize(kMaxParts);
  boxes.clear();
  for (const std::size_t seed : seeds_) {
    for (const PlaneBox& part : parts) boxes.emplace_back(seed, part);
  }
  add(SearchRung::area, boxes, area_m2, seeds_.size());
}

SearchRung SegmentPlacement::rung() const {
  if (searches_.empty()) return SearchRung::stated;
  return searches_[std::min(next_search_, searches_.size() - 1)].rung;
}

bool SegmentPlacement::searched_all() const { return next_search_ >= searches_.size(); }

double SegmentPlacement::reach_m() const {
  if (searches_.empty()) return 0;
  return half_side_m(searches_[std::min(next_search_, searches_.size() - 1)].box);
}

double SegmentPlacement::footprint_m(std::size_t index) const {
  return footprint_side_m(map_.camera.camera, shape_.frames[index].agl_m);
}

const cv::Mat& SegmentPlacement::image(std::size_t index) {
  const auto known = images_.find(index);
  if (known != images_.end()) return known->second;
  return images_[index] = map_.read(shape_.frames[index].frame);
}

AnchorPrior SegmentPlacement::prior_of(const SegmentSimilarity::Pose& pose, const ShapeFrame& frame,
                                       const Cancel& cancel) const {
  using namespace parameters::anchor_measurement;
  AnchorPrior prior;
  prior.search.pose = {
      pose.position, pose.agl_m, {pose.heading_rad, frame.attitude.pitch_rad, frame.attitude.roll_rad}};
  const double heading_sigma_rad = hypotenuse(pose.heading_sigma_rad, kTurnOfFrame_rad);
  prior.heading_sigma_rad = std::max(kLeastHeadingSigma_rad, heading_sigma_rad);
  prior.search.heading_range_rad = std::min(kPi, kHeadingSigmas * prior.heading_sigma_rad);
  prior.log_agl_sigma = std::max(kMinHeightSigma, pose.log_agl_sigma);
  prior.search.scale_range = kScaleSigmas * prior.log_agl_sigma;
  const double tilt_rad =
      frame.tilt_measured ? map_.camera.uncertainty.tilt_rad : parameters::flight_filter::kMissingTilt_rad;
  prior.tilt_covariance_rad2 = (square(tilt_rad) + kMinTiltVariance_rad2) * Eigen::Matrix2d::Identity();
  prior.cancel = cancel;
  return prior;
}

// ---- Search

void SegmentPlacement::search(const Search& where, const Cancel& cancel) {
  const cv::Mat& grey = image(where.seed);
  if (grey.empty() || hypotheses_.size() >= kHypotheses) return;
  const ShapeFrame& frame = shape_.frames[where.seed];
  SegmentSimilarity::Pose any;
  any.position = where.box.middle();
  any.heading_rad = frame.attitude.heading_rad;
  any.heading_sigma_rad = shape_.turn_sigma_rad;
  any.agl_m = frame.agl_m;
  any.log_agl_sigma = shape_.log_scale_sigma;
  const AnchorPrior prior = prior_of(any, frame, cancel);
  const AnchorMatch match = where.rung == SearchRung::index
                                ? map_.matcher.match_among(grey, prior, where.box, {std::nullopt, map_.places})
                                : map_.matcher.match_anywhere(grey, prior, where.box);
  const bool any_heading = shape_.turn_sigma_rad > kMeasuredTurn_rad;
  const double headings = any_heading ? std::min(1.0, kFoundTurn_rad / prior.search.heading_range_rad) : 1.0;
  const double window_m2 = square(2 * kWindow_m);
  for (const MatchHypothesis& place : match.search.places) {
    if (hypotheses_.size() >= kHypotheses) return;
    const double turn_rad = wrap_pi(place.pose.attitude.heading_rad - frame.attitude.heading_rad);
    const bool known = std::any_of(hypotheses_.begin(), hypotheses_.end(), [&](const auto& other) {
      return distance_m(other->similarity.pose(where.seed).position, place.pose.position) < kSamePlace_m &&
             std::abs(wrap_pi(other->similarity.turn_rad() - turn_rad)) < kSameTurn_rad;
    });
    if (known) continue;
    SegmentSimilarity::Prior begin;
    begin.reference = where.seed;
    begin.position = place.pose.position;
    begin.position_sigma_m = kFoundSigma_m;
    begin.turn_rad = any_heading ? turn_rad : 0;
    begin.turn_sigma_rad = any_heading ? kFoundTurn_rad : shape_.turn_sigma_rad;
    begin.log_scale_sigma = shape_.log_scale_sigma;
    auto& found = hypotheses_.emplace_back(std::make_unique<Hypothesis>(shape_, begin));
    found->seed = where.seed;
    found->likeness = std::clamp(place.score, 0.0, 1.0);
    found->log_odds = std::log(std::min(1.0, window_m2 / where.searched_m2) * headings / where.shared_by);
    found->begun_with = found->log_odds;
    // The seed first, then the frames next to it: there the prediction is sharp.
    found->left = evidence_;
    std::stable_sort(found->left.begin(), found->left.end(), [&](std::size_t a, std::size_t b) {
      const auto off = [&](std::size_t at) { return at > where.seed ? at - where.seed : where.seed - at; };
      return off(a) > off(b);
    });
  }
}

// ---- Look

void SegmentPlacement::look(Hypothesis& hypothesis, const Cancel& cancel) {
  const std::size_t index = hypothesis.left.back();
  const ShapeFrame& frame = shape_.frames[index];
  const cv::Mat& grey = image(index);
  if (grey.empty()) {
    hypothesis.left.pop_back();
    return;
  }
  const SegmentSimilarity::Pose predicted = hypothesis.similarity.pose(index);
  LookContext context;
  context.prior = prior_of(predicted, frame, cancel);
  context.prior.search.radius_m = std::max(kWindow_m, kWindowSigmas * std::sqrt(predicted.covariance_m2.trace() / 2));
  context.window = square_around(predicted.position, context.prior.search.radius_m);
  context.track = {predicted.position, predicted.covariance_m2};
  context.agl_m = frame.agl_m;
  context.footprint_m = footprint_m(index);
  context.tilt_missing = !frame.tilt_measured;
  const AnchorMatch match = map_.matcher.match(grey, context.prior);
  const Look look = look_of(match, context);

  double nearest_m = hypothesis.looked.empty() ? context.footprint_m : std::numeric_limits<double>::max();
  for (const std::size_t before : hypothesis.looked) {
    nearest_m = std::min(nearest_m, (shape_.frames[before].offset_m - frame.offset_m).norm());
  }
  const double new_ground = std::min(1.0, nearest_m / context.footprint_m);
  const double detection = belief::kDetectionHits / belief::kDetectionLooks;
  double hit = 0, chi2 = 0;
  if (look.candidate) {
    const Eigen::Vector2d off_m = look.candidate->position - predicted.position;
    const Eigen::Matrix2d spread_m2 = predicted.covariance_m2 + look.candidate->covariance_m2;
    chi2 = off_m.dot(spread_m2.inverse() * off_m);
    const bool itself = index == hypothesis.seed && hypothesis.hits == 0;
    const double concentrated = itself ? 1 : look.window.area_m2() * gaussian(off_m, spread_m2);
    hit = detection * std::exp(look.candidate->log_likelihood_ratio) * concentrated;
  }
  const double visible = belief::kInitialVisibility;
  const double likelihood = visible * (hit + 1 - detection) + 1 - visible;
  hypothesis.left.pop_back();
  hypothesis.looked.push_back(index);
  hypothesis.log_odds += new_ground * std::log(likelihood);
  if (!look.candidate || chi2 > belief::kChi2_999 || visible * hit < likelihood / 2) return;
  // What no model has, and the slope of the ground, over which all looks of a segment err alike, are no part of what
  // they average out: the whole has an allowance for both (common_variance_m2()). As evidence a look may differ by
  // them. A slope that moves looks farther than the allowance stays with them: a narrow lens, or no measured tilt. The
  // error of the tilt counts as it is stated: the factor is for what the solver does not model of the ground.
  const double factor = anchor_model_error_factor(context.tilt_missing);
  const double allowed_m2 = unmodelled_variance_m2(context.agl_m);
  const Eigen::Matrix2d& slope_m2 = match.solved->slope_covariance_m2;
  const Eigen::Matrix2d tilt_m2 = tilt_covariance_m2(*match.solved, context.prior.tilt_covariance_rad2);
  const double shared = std::min(1.0, 2 * allowed_m2 / std::max(slope_m2.trace(), allowed_m2));
  const Eigen::Matrix2d own_m2 = look.candidate->covariance_m2 - allowed_m2 * Eigen::Matrix2d::Identity() -
                                 factor * shared * slope_m2 - (factor - 1) * tilt_m2;
  const double heading_variance = factor * match.solved->covariance(3, 3);
  hypothesis.similarity.add({.index = index,
                             .position = look.candidate->position,
                             .covariance_m2 = own_m2,
                             .heading_rad = match.solved->pose.attitude.heading_rad,
                             .heading_sigma_rad = std::sqrt(heading_variance + square(kTurnOfFrame_rad))});
  ++hypothesis.hits;
  if (match.map_ce90_m) hypothesis.map_ce90_m = std::max(hypothesis.map_ce90_m.value_or(0), *match.map_ce90_m);
  hypothesis.footprints += new_ground;
}

// ---- Decide

const SegmentPlacement::Hypothesis* SegmentPlacement::best() const {
  const Hypothesis* best = nullptr;
  for (const auto& each : hypotheses_) {
    if (best == nullptr || each->log_odds > best->log_odds) best = each.get();
  }
  return best;
}

double SegmentPlacement::doubt_of(const Hypothesis& hypothesis) const {
  double others = std::exp(-hypothesis.log_odds);  // somewhere else
  for (const auto& each : hypotheses_) {
    if (each.get() != &hypothesis) others += std::exp(each->log_odds - hypothesis.log_odds);
  }
  return others / (1 + others);
}

bool SegmentPlacement::accepted(const Hypothesis& hypothesis) const {
  return hypothesis.left.empty() && hypothesis.hits >= kLeastHits && hypothesis.footprints >= kLeastFootprints &&
         doubt_of(hypothesis) <= belief::kMaxPlaceDoubt;
}

// The best one that is not settled; where the best of all is settled, its rivals in as many frames as they need.
SegmentPlacement::Hypothesis* SegmentPlacement::next_to_look_at() {
  if (looks_left_ <= 0) return nullptr;
  std::vector<Hypothesis*> ranked;
  for (const auto& each : hypotheses_) ranked.push_back(each.get());
  std::stable_sort(ranked.begin(), ranked.end(),
                   [](const Hypothesis* a, const Hypothesis* b) { return a->log_odds > b->log_odds; });
  if (ranked.empty()) return nullptr;
  if (!accepted(*ranked.front())) {
    for (Hypothesis* each : ranked) {
      if (!each->settled()) return each;
    }
    return nullptr;
  }
  for (std::size_t i = 1; i < std::min(ranked.size(), kRivals + 1); ++i) {
    if (!ranked[i]->left.empty() && ranked[i]->looked.size() < kRivalLooks) return ranked[i];
  }
  return nullptr;
}

bool SegmentPlacement::step(const Cancel& cancel) {
  cancel.check();
  if (searches_.empty()) return false;
  // All searches of a rung with one seed, then looks; the next ones only where that decides nothing.
  const bool searching = next_search_ < searches_.size() &&
                         (next_search_ == 0 || searches_[next_search_].goes_on(searches_[next_search_ - 1]));
  if (!searching) {
    if (Hypothesis* next = next_to_look_at()) {
      --looks_left_;
      look(*next, cancel);
      return true;
    }
    const Hypothesis* found = best();
    if ((found != nullptr && accepted(*found)) || next_search_ >= searches_.size()) return false;
  }
  search(searches_[next_search_], cancel);
  ++next_search_;
  looks_left_ = kLooksOfSeed;
  return true;
}

SegmentPlacementResult SegmentPlacement::result() const {
  SegmentPlacementResult result;
  std::vector<const Hypothesis*> ranked;
  for (const auto& each : hypotheses_) ranked.push_back(each.get());
  std::stable_sort(ranked.begin(), ranked.end(),
                   [](const Hypothesis* a, const Hypothesis* b) { return a->log_odds > b->log_odds; });
  if (ranked.empty()) return result;
  const std::size_t shown = seeds_.front();
  for (std::size_t i = 0; i < std::min(kCandidates, ranked.size()); ++i) {
    const SegmentSimilarity::Pose pose = ranked[i]->similarity.pose(shown);
    const double sigma_m = std::sqrt(pose.covariance_m2.trace() / 2);
    result.candidates.push_back({.frame = shape_.frames[shown].frame,
                                 .position = pose.position,
                                 .heading_rad = pose.heading_rad,
                                 .likeness = ranked[i]->likeness,
                                 .posterior = 1 - doubt_of(*ranked[i]),
                                 .radius_m = std::max(kLeastCandidateRadius_m, kCandidateSigmas * sigma_m)});
  }
  const Hypothesis& best = *ranked.front();
  result.log_odds = best.log_odds;
  result.doubt = doubt_of(best);
  result.looks = static_cast<int>(best.looked.size());
  result.hits = best.hits;
  result.map_ce90_m = best.map_ce90_m;
  result.turn_rad = best.similarity.turn_rad();
  result.log_scale = best.similarity.log_scale();
  if (!accepted(best)) return result;
  result.hit.resize(shape_.frames.size(), false);
  SegmentSimilarity placed = best.similarity;
  placed.scale_looks_by_scatter();
  for (std::size_t i = 0; i < shape_.frames.size(); ++i) result.poses.push_back(placed.pose(i));
  for (const ShapeLook& look : best.similarity.looks()) result.hit[look.index] = true;
  return result;
}

}  // namespace nadir
