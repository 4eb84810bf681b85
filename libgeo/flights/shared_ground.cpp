#include "flights/shared_ground.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/calib3d.hpp>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "estimation/odometry_features.hpp"
#include "estimation/terrain_surface.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/hypotenuse.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {
namespace {

// Chosen, all of them; what a match of two pictures is, odometry decides (localizer_parameters.hpp).
constexpr std::size_t kComparedPictures = 12;    // of a segment
constexpr std::size_t kMostReferences = 120;     // that a segment is compared with: bounds the time
constexpr std::size_t kMostComparisons = 1500;   // of a reference with a segment, in a flight: likewise
constexpr double kSpacing = 0.35;                // footprints between references, and between frames of a segment
constexpr double kMostReferenceSigma_m = 15;     // one axis; a place that is known worse than this is no reference
constexpr int kLeastInliers = 25;                // of a match
constexpr double kLeastInlierShare = 0.25;       // … of the features that are alike
constexpr std::size_t kLeastFrames = 2;          // of the segment that agree …
constexpr int kLeastInliersTogether = 80;        // … with so many inliers …
constexpr double kLeastShareAgreeing = 0.75;     // … of those that match anything at all
constexpr std::size_t kEnoughFrames = 5;         // that agree: no further pictures are compared
constexpr double kVague_m = 300;                 // σ of the first frame's place before any match
constexpr double kMatchedTurn_rad = radians(6);  // σ of the segment's turn before any match, where headings are unknown
constexpr double kMeasuredHeading_rad = radians(20);  // headings better known than this count
constexpr double kTurnOfPicture_rad = radians(1.5);   // of one frame's heading against the segment's, 1-σ
constexpr double kImageTurn_rad = radians(3);         // of the turn between two pictures as their features show it
constexpr double kMostLogScale = 0.35;  // of two pictures of the same ground beyond their heights' ratio: tilt
constexpr double kTurnSigmas = 4;
constexpr double kLeastOwnSigma_m = 0.3;  // of a reference's place against other references
constexpr double kChi2Of3 = 16.27;        // 99.9 % with three degrees of freedom: place and heading

double squared(double value) { return value * value; }

// A frame whose place is known.
struct Reference {
  std::size_t frame = 0;
  int segment = 0;
  CameraPose pose;
  Eigen::Matrix2d covariance_m2 = Eigen::Matrix2d::Zero();
  double heading_sigma_rad = 0, log_agl_sigma = 0;
};

// What one picture of the segment and one reference show of each other.
struct Match {
  std::size_t index = 0;  // in the shape
  Reference reference;
  Eigen::Vector2d displacement_m = Eigen::Vector2d::Zero();
  Eigen::Matrix2d covariance_m2 = Eigen::Matrix2d::Zero();
  double heading_rad = 0;  // of the segment's frame
  double heading_sigma_rad = 0;
  int inliers = 0;
};

struct Floating {
  FlightSegment segment;
  SegmentShape shape;
  std::vector<std::size_t> compared_frames;  // indices in the shape
  std::vector<Match> matches;
  std::set<std::size_t> compared;                    // references
  std::map<std::size_t, OdometryFeatures> features;  // by index in the shape
};

// A similarity of the segment, and the matches that agree on it.
struct Agreement {
  std::unique_ptr<SegmentSimilarity> similarity;
  std::set<std::size_t> frames, contradicting;  // indices in the shape
  std::set<int> basis;                          // segments of the references
  int inliers = 0;

  bool enough() const {
    const auto matched = static_cast<double>(frames.size() + contradicting.size());
    return frames.size() >= kLeastFrames && inliers >= kLeastInliersTogether &&
           static_cast<double>(frames.size()) >= kLeastShareAgreeing * matched;
  }
};

}  // namespace

struct SharedGround::Impl {
  Impl(FlightStore& flight_store, const PlacerSetup& placer_setup) : store(flight_store), setup(placer_setup) {}

  const GroundSurface& surface() const {
    return setup.localizer.surface != nullptr ? *setup.localizer.surface : static_cast<const GroundSurface&>(flat);
  }
  void find_references();
  Floating* next();
  // What is left to compare with, the next one first.
  std::vector<const Reference*> left_of(const Floating& floating) const;
  OdometryFrame seen_from(const CameraPose& pose, double heading_sigma_rad, double log_agl_sigma) const;
  const OdometryFeatures* features_of(const Reference& reference);
  const OdometryFeatures* features_of(Floating& floating, std::size_t index);
  void compare(Floating& floating, const Reference& reference, const Cancel& cancel);
  std::optional<Match> match(const Floating& floating, std::size_t index, const OdometryFeatures& seen,
                             const Reference& reference, const OdometryFeatures& known) const;
  Agreement agreement(const Floating& floating) const;
  bool place(const Floating& floating, const Agreement& agreed);

  FlightStore& store;
  PlacerSetup setup;
  FlatGround flat;
  std::vector<Reference> references;
  std::set<int> placed_segments;                                // whose frames may be references
  std::int64_t known_by = -1;                                   // the last event when these were found
  std::map<int, Floating> floating;                             // by segment
  std::map<std::size_t, std::optional<OdometryFeatures>> kept;  // of references; nothing: shows too little
  std::size_t comparisons = 0;
};

SharedGround::SharedGround(FlightStore& store, const PlacerSetup& setup)
    : impl_(std::make_unique<Impl>(store, setup)) {}

SharedGround::~SharedGround() = default;

// ---- References

void SharedGround::Impl::find_references() {
  if (store.last_event() == known_by) return;
  known_by = store.last_event();
  references.clear();
  placed_segments.clear();
  std::vector<std::optional<int>> known(store.processed());  // by frame: the segment that is placed there
  for (const FlightSegment& segment : store.segments()) {
    if (segment.state == SegmentState::floating) continue;
    placed_segments.insert(segment.number);
    const std::size_t first = segment.anchored_frame.value_or(segment.first_frame);
    for (std::size_t i = first; i <= segment.last_frame && i < known.size(); ++i) known[i] = segment.number;
  }
  const std::vector<Estimate> online = store.estimates(EstimateKind::online);
  for (std::size_t i = 0; i < known.size() && i < online.size(); ++i) {
    if (!known[i] || online[i].segment != *known[i]) continue;  // an outlier within
    EstimateRecord record{i, online[i], {}, {}};
    if (const auto placed = store.placed_estimate(i)) {
      record = *placed;
    } else {
      record.state = store.stored_frame(i).online.state;
    }
    const Estimate& estimate = record.estimate;
    if (!estimate.position || !(estimate.sigma_m <= kMostReferenceSigma_m) || !(record.state.agl_m > 0)) continue;
    Reference reference;
    reference.frame = i;
    reference.segment = *known[i];
    reference.pose.position = setup.frame.plane_from_lonlat(*estimate.position);
    reference.pose.agl_m = record.state.agl_m;
    const double apart_m = kSpacing * footprint_side_m(setup.camera.camera, reference.pose.agl_m);
    if (std::any_of(references.begin(), references.end(), [&](const Reference& other) {
          return distance_m(other.pose.position, reference.pose.position) < apart_m;
        })) {
      continue;
    }
    const Telemetry telemetry = plausible_telemetry(store.picture(i).telemetry, estimate.time_s);
    reference.pose.attitude = {record.state.heading_rad, telemetry.pitch_rad.value_or(0),
                               telemetry.roll_rad.value_or(0)};
    reference.covariance_m2 = estimate.covariance_m2;
    reference.heading_sigma_rad = record.state.heading_sigma_rad;
    reference.log_agl_sigma = record.state.agl_sigma_m / record.state.agl_m;
    references.push_back(reference);
  }
}

// A match shows where the others are; before, dead reckoning does.
std::vector<const Reference*> SharedGround::Impl::left_of(const Floating& one) const {
  std::optional<PlanePoint> around;
  if (!one.matches.empty()) around = one.matches.back().reference.pose.position;
  if (!around) {
    const std::size_t middle = one.shape.frames[one.shape.frames.size() / 2].frame;
    const auto online = store.estimates(EstimateKind::online, middle, 1);
    if (!online.empty() && online.front().position) around = setup.frame.plane_from_lonlat(*online.front().position);
  }
  std::vector<const Reference*> left;
  for (const Reference& reference : references) {
    if (!one.compared.contains(reference.frame)) left.push_back(&reference);
  }
  if (around) {
    std::stable_sort(left.begin(), left.end(), [&](const Reference* a, const Reference* b) {
      return distance_m(a->pose.position, *around) < distance_m(b->pose.position, *around);
    });
  }
  const std::size_t most = kMostReferences - std::min(kMostReferences, one.compared.size());
  if (left.size() > most) left.resize(most);
  return left;
}

// The next segment that there is something to compare with.
Floating* SharedGround::Impl::next() {
  for (const FlightSegment& segment : store.segments()) {
    if (segment.state != SegmentState::floating || segment.first_frame == segment.last_frame) {
      floating.erase(segment.number);
      continue;
    }
    if (store.merge_taken_back(segment)) continue;
    Floating& one = floating[segment.number];
    if (one.segment != segment) {
      one = {};
      one.segment = segment;
      one.shape = stored_shape(store, segment, setup.camera.uncertainty);
      std::optional<Eigen::Vector2d> last_m;
      for (std::size_t i = 0; i < one.shape.frames.size() && one.compared_frames.size() < kComparedPictures; ++i) {
        const ShapeFrame& frame = one.shape.frames[i];
        const double apart_m = kSpacing * footprint_side_m(setup.camera.camera, std::max(1.0, frame.agl_m));
        if (!frame.usable || (last_m && (frame.offset_m - *last_m).norm() < apart_m)) continue;
        last_m = frame.offset_m;
        one.compared_frames.push_back(i);
      }
      // A short one: every frame that there is.
      if (one.compared_frames.size() < 2 * kLeastFrames) {
        one.compared_frames.clear();
        for (std::size_t i = 0; i < one.shape.frames.size() && one.compared_frames.size() < kComparedPictures; ++i) {
          if (one.shape.frames[i].usable) one.compared_frames.push_back(i);
        }
      }
    }
    if (one.compared_frames.size() < kLeastFrames) continue;
    if (!left_of(one).empty()) return &one;
    one.features.clear();
  }
  return nullptr;
}

// ---- Pictures

OdometryFrame SharedGround::Impl::seen_from(const CameraPose& pose, double heading_sigma_rad,
                                            double log_agl_sigma) const {
  using namespace parameters::tracking;
  const double footprint_m = footprint_side_m(setup.camera.camera, pose.agl_m);
  OdometryFrame seen;
  seen.camera = setup.camera.camera;
  seen.attitude = pose.attitude;
  seen.agl_m = pose.agl_m;
  seen.linearization_point.heading_rad = pose.attitude.heading_rad;
  seen.heading_sigma_rad = heading_sigma_rad;
  seen.tilt_sigma_rad = setup.camera.uncertainty.tilt_rad;
  const double slope = surface().relief_sigma_m() / footprint_m;
  seen.boresight_covariance_rad2 = slope * slope * Eigen::Matrix2d::Identity();
  seen.ground_slope = ground_slope(surface(), pose.position, footprint_m / kSlopeBaselineDivisor);
  seen.relief_sigma_m = surface().relief_sigma_m();
  seen.relative_height_sigma = std::max(setup.camera.uncertainty.agl_relative, log_agl_sigma);
  return seen;
}

const OdometryFeatures* SharedGround::Impl::features_of(const Reference& reference) {
  const auto known = kept.find(reference.frame);
  if (known != kept.end()) return known->second ? &*known->second : nullptr;
  auto& features = kept[reference.frame];
  OdometryFrame seen = seen_from(reference.pose, reference.heading_sigma_rad, reference.log_agl_sigma);
  seen.grey = setup.read(reference.frame);
  if (seen.grey.empty()) return nullptr;
  return &features.emplace(odometry_features(seen));
}

const OdometryFeatures* SharedGround::Impl::features_of(Floating& one, std::size_t index) {
  const auto known = one.features.find(index);
  if (known != one.features.end()) return &known->second;
  const ShapeFrame& frame = one.shape.frames[index];
  OdometryFrame seen = seen_from({{}, frame.agl_m, frame.attitude}, kImageTurn_rad, one.shape.log_scale_sigma);
  seen.grey = setup.read(frame.frame);
  if (seen.grey.empty()) return nullptr;
  return &one.features.emplace(index, odometry_features(seen)).first->second;
}

void SharedGround::Impl::compare(Floating& one, const Reference& reference, const Cancel& cancel) {
  const OdometryFeatures* known = features_of(reference);
  std::vector<Match> found;
  for (const std::size_t index : one.compared_frames) {
    cancel.check();
    if (known == nullptr) break;
    const OdometryFeatures* seen = features_of(one, index);
    if (seen == nullptr) continue;
    if (auto matched = match(one, index, *seen, reference, *known)) found.push_back(*matched);
  }
  one.compared.insert(reference.frame);
  one.matches.insert(one.matches.end(), found.begin(), found.end());
}

std::optional<Match> SharedGround::Impl::match(const Floating& one, std::size_t index, const OdometryFeatures& seen,
                                               const Reference& reference, const OdometryFeatures& known) const {
  const PixelPairs pairs = similar_pixels(known, seen);
  if (static_cast<int>(pairs.now.size()) < kLeastInliers) return std::nullopt;
  // How the picture is turned and scaled against the reference's.
  const cv::Mat similarity = cv::estimateAffinePartial2D(pairs.before, pairs.now, cv::noArray(), cv::RANSAC,
                                                         2 * parameters::visual_odometry::kHomographyThreshold_px);
  if (similarity.empty()) return std::nullopt;
  const double c = similarity.at<double>(0, 0), s = similarity.at<double>(1, 0);
  const double expected_scale = reference.pose.agl_m / seen.frame.agl_m;
  if (!(std::abs(std::log(hypotenuse(c, s) / expected_scale)) < kMostLogScale)) return std::nullopt;
  OdometryFrame now = seen.frame;
  // Image-up turns clockwise over the ground as the ground turns counter-clockwise in the image.
  now.attitude.heading_rad = wrap_pi(reference.pose.attitude.heading_rad - std::atan2(s, c));
  now.linearization_point.heading_rad = now.attitude.heading_rad;
  now.boresight_covariance_rad2 = known.frame.boresight_covariance_rad2;
  const auto measured = measure_motion(known.frame, now, pairs);
  if (!measured || measured->step.inliers < kLeastInliers ||
      measured->step.inliers < kLeastInlierShare * static_cast<double>(pairs.now.size())) {
    return std::nullopt;
  }
  const OdometryStep& step = measured->step;
  Match result;
  result.index = index;
  result.reference = reference;
  result.displacement_m = step.displacement_m;
  const double turned_m = step.displacement_m.norm() * hypotenuse(reference.heading_sigma_rad, reference.log_agl_sigma);
  result.covariance_m2 = step.covariance_m2 + squared(turned_m) * Eigen::Matrix2d::Identity();
  result.heading_rad = wrap_pi(now.attitude.heading_rad + step.measurement.value[3]);
  result.heading_sigma_rad = hypotenuse(hypotenuse(reference.heading_sigma_rad, kTurnOfPicture_rad),
                                        std::sqrt(std::min(1.0, step.measurement.covariance(3, 3))));
  result.inliers = step.inliers;
  const double turn_rad = wrap_pi(result.heading_rad - one.shape.frames[index].attitude.heading_rad);
  const double turn_sigma_rad = hypotenuse(one.shape.turn_sigma_rad, result.heading_sigma_rad);
  if (one.shape.turn_sigma_rad < kMeasuredHeading_rad && std::abs(turn_rad) > kTurnSigmas * turn_sigma_rad)
    return std::nullopt;
  return result;
}

// ---- Agreement

namespace {

// Of a reference's place, what differs from that of other references.
Eigen::Matrix2d own_part(const Eigen::Matrix2d& covariance_m2, double common_m2) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> eigen(covariance_m2 - common_m2 * Eigen::Matrix2d::Identity());
  const Eigen::Vector2d least = eigen.eigenvalues().cwiseMax(squared(kLeastOwnSigma_m));
  return eigen.eigenvectors() * least.asDiagonal() * eigen.eigenvectors().transpose();
}

}  // namespace

// By each match as the first one; the best.
Agreement SharedGround::Impl::agreement(const Floating& one) const {
  struct PlacedMatch {
    ShapeLook look;
    const Match* match;
  };
  std::vector<PlacedMatch> looks;
  for (const Match& match : one.matches) {
    const Reference& reference = match.reference;
    if (!placed_segments.contains(reference.segment)) continue;  // it floats again
    const double common_m2 = common_variance_m2(setup.localizer, std::nullopt, reference.pose.agl_m);
    looks.push_back({{.index = match.index,
                      .position = PlanePoint(reference.pose.position.vector() + match.displacement_m),
                      .covariance_m2 = match.covariance_m2 + own_part(reference.covariance_m2, common_m2),
                      .heading_rad = match.heading_rad,
                      .heading_sigma_rad = match.heading_sigma_rad},
                     &match});
  }
  const bool any_heading = one.shape.turn_sigma_rad >= kMeasuredHeading_rad;
  Agreement best;
  for (const PlacedMatch& first : looks) {
    const double heading_rad = one.shape.frames[first.look.index].attitude.heading_rad;
    Agreement now;
    const SegmentSimilarity::Prior vague{.reference = first.look.index,
                                         .position = first.look.position,
                                         .position_sigma_m = kVague_m,
                                         .turn_rad = any_heading ? wrap_pi(first.look.heading_rad - heading_rad) : 0.0,
                                         .turn_sigma_rad = any_heading ? kMatchedTurn_rad : one.shape.turn_sigma_rad,
                                         .log_scale_sigma = one.shape.log_scale_sigma};
    now.similarity = std::make_unique<SegmentSimilarity>(one.shape, vague);
    std::vector<const PlacedMatch*> order;
    for (const PlacedMatch& look : looks) order.push_back(&look);
    // Neighbours first: there the prediction is sharp.
    std::stable_sort(order.begin(), order.end(), [&](const PlacedMatch* a, const PlacedMatch* b) {
      const auto off = [&](const PlacedMatch* look) {
        if (look == &first) return -1;
        return std::abs(static_cast<int>(look->look.index) - static_cast<int>(first.look.index));
      };
      return off(a) < off(b);
    });
    std::set<std::size_t> contradicting;
    for (const PlacedMatch* look : order) {
      const SegmentSimilarity::Pose predicted = now.similarity->pose(look->look.index);
      const Eigen::Vector2d off_m = look->look.position - predicted.position;
      const Eigen::Matrix2d spread_m2 = predicted.covariance_m2 + look->look.covariance_m2;
      const double turn_rad = wrap_pi(look->look.heading_rad - predicted.heading_rad);
      const double turn_variance = squared(predicted.heading_sigma_rad) + squared(look->look.heading_sigma_rad);
      const double chi2 = off_m.dot(spread_m2.inverse() * off_m) + squared(turn_rad) / turn_variance;
      if (chi2 > kChi2Of3) {
        contradicting.insert(look->look.index);
        continue;
      }
      now.similarity->add(look->look);
      now.frames.insert(look->look.index);
      now.basis.insert(look->match->reference.segment);
      now.inliers += look->match->inliers;
    }
    for (const std::size_t index : contradicting) {
      if (!now.frames.contains(index)) now.contradicting.insert(index);
    }
    if (std::pair(now.frames.size(), now.inliers) > std::pair(best.frames.size(), best.inliers)) best = std::move(now);
  }
  return best;
}

bool SharedGround::Impl::place(const Floating& one, const Agreement& agreed) {
  std::vector<EstimateRecord> placed;
  double worst_m = 0;
  for (std::size_t i = 0; i < one.shape.frames.size(); ++i) {
    const ShapeFrame& frame = one.shape.frames[i];
    const double common_m2 = common_variance_m2(setup.localizer, std::nullopt, frame.agl_m);
    placed.push_back(
        placed_estimate(store, setup, frame, agreed.similarity->pose(i), common_m2, SourceLabel::vo_extrapolated));
    worst_m = std::max(worst_m, placed.back().estimate.sigma_m);
  }
  const LonLat first = setup.frame.lonlat_from_plane(agreed.similarity->pose(0).position);
  const nlohmann::json body{{"segment", one.segment.number},
                            {"by", "ground"},
                            {"onto", agreed.basis},
                            {"frames", placed.size()},
                            {"looks", one.compared.size() * one.compared_frames.size()},
                            {"hits", agreed.frames.size()},
                            {"inliers", agreed.inliers},
                            {"lat_deg", first.lat_deg},
                            {"lon_deg", first.lon_deg},
                            {"turn_deg", degrees(agreed.similarity->turn_rad())},
                            {"scale", std::exp(agreed.similarity->log_scale())},
                            {"sigma_m", worst_m}};
  const StoredFlightEvent event{FlightEventKind::segments_merged, one.segment.first_frame,
                                body.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace)};
  const std::vector<int> basis(agreed.basis.begin(), agreed.basis.end());
  return store.merge_segment(one.segment, placed, event, setup.clock(), basis);
}

PlacerOutcome SharedGround::step(const Cancel& cancel) {
  Impl& s = *impl_;
  cancel.check();
  const auto floats = [](const FlightSegment& segment) {
    return segment.state == SegmentState::floating && segment.first_frame < segment.last_frame;
  };
  const std::vector<FlightSegment> segments = s.store.segments();
  if (s.comparisons >= kMostComparisons || std::none_of(segments.begin(), segments.end(), floats)) {
    s.kept.clear();
    return PlacerOutcome::nothing_to_do;
  }
  s.find_references();
  Floating* one = s.next();
  if (one == nullptr) {
    s.kept.clear();
    return PlacerOutcome::nothing_to_do;
  }
  ++s.comparisons;
  const std::size_t matches = one->matches.size();
  s.compare(*one, *s.left_of(*one).front(), cancel);
  const bool last = s.left_of(*one).empty();
  if (one->matches.size() == matches && !last) return PlacerOutcome::more_to_do;
  const Agreement agreed = s.agreement(*one);
  if (!agreed.enough() || (agreed.frames.size() < kEnoughFrames && !last)) return PlacerOutcome::more_to_do;
  const bool merged = s.place(*one, agreed);
  s.floating.erase(one->segment.number);
  return merged ? PlacerOutcome::merged : PlacerOutcome::more_to_do;
}

}  // namespace nadir
