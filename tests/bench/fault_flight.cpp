#include "fault_flight.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/error.hpp"
#include "estimation/look_likelihood.hpp"
#include "estimation/map_look.hpp"
#include "estimation/pose_measurements.hpp"
#include "estimation/tracking_state.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir::bench {
namespace {

using namespace parameters::anchor_measurement;
using namespace parameters::belief;

struct NamedFault {
  FlightFault fault;
  std::string_view code, name;
  bool in_flight = true;  // it may begin there as well
};
constexpr std::array kFaults = {
    NamedFault{FlightFault::none, "none", "no fault"},
    NamedFault{FlightFault::unchecked_pairs, "unchecked_pairs", "no fault, maps of unchecked registration"},
    NamedFault{FlightFault::start_500, "start_500", "start 150 to 500 m off", false},
    NamedFault{FlightFault::start_2000, "start_2000", "start 500 to 2000 m off", false},
    NamedFault{FlightFault::other_map, "other_map", "map does not show the place"},
    NamedFault{FlightFault::start_and_map, "start_and_map", "start 150 to 500 m off, and such a map", false},
    NamedFault{FlightFault::half_changed, "half_changed", "half of the map has changed"},
    NamedFault{FlightFault::clouds, "clouds", "clouds"},
    NamedFault{FlightFault::blur, "blur", "blur"},
    NamedFault{FlightFault::night, "night", "night"},
    NamedFault{FlightFault::map_50, "map_50", "map 50 m off"},
    NamedFault{FlightFault::map_200, "map_200", "map 200 m off"},
    NamedFault{FlightFault::map_1000, "map_1000", "map 1000 m off"},
    NamedFault{FlightFault::foreign_frames, "foreign_frames", "1 to 5 foreign frames"},
    NamedFault{FlightFault::wrong_anchor, "wrong_anchor", "wrong anchor accepted, a minute later", false},
    NamedFault{FlightFault::odometry, "odometry", "odometry 5 % too long"},
    NamedFault{FlightFault::wrong_motion, "wrong_motion", "a wrong motion of odometry is accepted"},
};

std::vector<FaultKind> made_kinds() {
  std::vector<FaultKind> kinds;
  for (const NamedFault& f : kFaults) {
    const std::string name(f.name), code(f.code);
    kinds.push_back({name, code, f.fault, Onset::start});
    if (f.in_flight) kinds.push_back({name + ", in flight", code + "_in_flight", f.fault, Onset::in_flight});
  }
  return kinds;
}

constexpr std::uint64_t kFirstKinds = 28;  // have their numbers in turns, since the first results that were stored
constexpr std::uint64_t kLaterKind = 1'000'000;  // each of the others has so many of its own

// The flight: a light drone 200 m above ground.
constexpr double kSpeed_mps = 20, kFootprint_m = 255, kFlightAgl_m = 200;
constexpr double kLeastNewGround = 0.1;
constexpr double kStartSigma_m = 20, kClaimedSigma_m = 50;
constexpr double kWideStartFactor = 2;    // σ of wide starts
constexpr double kMinutesBefore = 5;      // without a fault, before one that begins in flight
constexpr double kArea_m = 3000;          // to each side of the truth
constexpr double kDriftShare = 0.03;      // σ of the drift, of the way: a camera file's height
constexpr double kStepShare = 0.02;       // σ of the random walk
constexpr double kBrokenStepShare = 0.1;  // without it: telemetry alone
constexpr double kLongOdometry = 0.05;
constexpr double kOverlapSeen = 0.8;  // above this share of new ground nothing tells that a frame is foreign
constexpr double kHappensFrom_s = 60, kHappensTo_s = 180;
constexpr int kMostFrames = 5;  // that are foreign, or led by a wrong motion
// Wrong motions.
constexpr double kSparseGround = 0.7;  // from this share of new ground on odometry may have no right motion
constexpr double kLeastVague = 0.1, kMostVague = 0.75;  // σ of the prediction, of the way; most: a velocity of 15 m/s
constexpr double kTurnSigma_rad = 0.05;
constexpr double kFrameShape = 0.75;  // shorter side over longer
constexpr int kFewInliers = 12;
constexpr double kWrongAnchorCountsFrom_s = 60;
constexpr int kMostWrongHits = 50;
constexpr double kFarShare = 0.4;  // of the alert limit: σ that is added for the score of the hazardous event
constexpr double kWarned = 10;     // takes so much off the score for each factor e of the level beyond the alert limit
constexpr double kNoLevel_m = 10'000;
constexpr double kLeastScore = -50;

Eigen::Vector2d random_direction(Random& random) {
  const double angle = random.uniform(-std::numbers::pi, std::numbers::pi);
  return {std::cos(angle), std::sin(angle)};
}

Eigen::Vector2d normal_vector(double sigma_m, Random& random) {
  const double east = random.normal(0, sigma_m), north = random.normal(0, sigma_m);
  return {east, north};
}

double normal_density(const Eigen::Vector2d& at, double sigma_m) {
  return std::exp(-at.squaredNorm() / (2 * sigma_m * sigma_m)) / (2 * std::numbers::pi * sigma_m * sigma_m);
}

double larger_eigenvalue(const Eigen::Matrix2d& m) {
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(m, Eigen::EigenvaluesOnly).eigenvalues()[1];
}

double one_axis_sigma_m(const Eigen::Matrix2d& m) { return std::sqrt(m.trace() / 2); }

PlaneBox square(const Eigen::Vector2d& middle, double half_side_m) {
  return {middle.x() - half_side_m, middle.y() - half_side_m, middle.x() + half_side_m, middle.y() + half_side_m};
}

bool inside(const PlaneBox& box, const Eigen::Vector2d& p) {
  return p.x() >= box.west_m && p.x() <= box.east_m && p.y() >= box.south_m && p.y() <= box.north_m;
}

Eigen::Matrix2d common_m2(bool anchored) {
  return anchored ? shared_error_m2(parameters::localizer::kMapSigma_m, kFlightAgl_m) : Eigen::Matrix2d::Zero();
}

const char* picture_of(FlightFault fault) {
  switch (fault) {
    case FlightFault::half_changed: return "old";
    case FlightFault::clouds: return "clouds";
    case FlightFault::blur: return "blur";
    case FlightFault::night: return "night";
    default: return "clear";
  }
}

// The start that was given is.
bool starts_off(FlightFault fault) {
  return fault == FlightFault::start_500 || fault == FlightFault::start_2000 || fault == FlightFault::start_and_map;
}

// The second best place of what was found, as far from the candidate and from the place that is shown as measured, on
// either side of the line through both. Where one of them is not near the place, in any direction.
LookCandidate rival_of(const LookCandidate& candidate, const LookFinding& found, const Eigen::Vector2d& shown_m,
                       Random& random) {
  const LookFinding::Rival& rival = found.rival;
  const Eigen::Vector2d to_place_m = shown_m - candidate.position.vector();
  const double side = random.chance(0.5) ? 1 : -1, off_m = to_place_m.norm();
  const Eigen::Vector2d direction = random_direction(random);
  Eigen::Vector2d at_m = candidate.position.vector() + rival.apart_m * direction;
  if (rival.error_m > 0 && found.error_m > 0) {
    const double cosine =
        (off_m * off_m + rival.apart_m * rival.apart_m - rival.error_m * rival.error_m) / (2 * off_m * rival.apart_m);
    const double angle = side * std::acos(std::clamp(cosine, -1.0, 1.0));
    at_m = candidate.position.vector() + rival.apart_m / off_m * (Eigen::Rotation2Dd(angle) * to_place_m);
  } else if (rival.error_m > 0) {
    at_m = shown_m + rival.error_m * direction;
  }
  return {PlanePoint(at_m), candidate.covariance_m2 + rival.searched_m * rival.searched_m * Eigen::Matrix2d::Identity(),
          rival.log_likelihood_ratio};
}

// Of a candidate that is seen again.
LookCandidate moved_with(LookCandidate rival, const LookCandidate& last, const LookCandidate& now) {
  rival.position = PlanePoint(rival.position.vector() + (now.position - last.position));
  rival.log_likelihood_ratio += now.log_likelihood_ratio - last.log_likelihood_ratio;
  return rival;
}

// The filter is corrected as the localizer corrects its own (map_look.hpp, anchor_measurement()).
void correct(FaultFlight::State& s, const LookCandidate& candidate, const CandidateSigmas& sigmas,
             const LookResult& look) {
  const Eigen::Matrix2d before_m2 = s.covariance_m2();
  const Eigen::Vector2d off = candidate.position.vector() - s.error_m();
  const double shared =
      s.anchored ? std::max(1.0, kSharedErrorFootprints * kFootprint_m / std::max(1.0, s.since_anchor_m)) : 1;
  if (look.contradicted) s.covariance.topLeftCorner<2, 2>() += off.squaredNorm() * Eigen::Matrix2d::Identity();
  double variance_m2 = sigmas.solved_m * sigmas.solved_m * shared;
  const Eigen::Matrix2d innovation_m2 =
      s.covariance_m2() + (variance_m2 + unmodelled_variance_m2(kFlightAgl_m)) * Eigen::Matrix2d::Identity();
  variance_m2 += wrong_consensus_left_m2(sigmas.wrong_consensus_m * sigmas.wrong_consensus_m, innovation_m2, off);
  const Eigen::Matrix2d measured_m2 = variance_m2 * Eigen::Matrix2d::Identity();
  const Eigen::Matrix<double, 4, 2> gain =
      s.covariance.leftCols<2>() *
      (s.covariance_m2() + weighted_by_association(measured_m2, look.association_doubt, s.covariance_m2())).inverse();
  s.error += gain * off;
  s.covariance -= (gain * s.covariance.topRows<2>()).eval();
  s.belief.on_anchor(gain.topRows<2>() * off, before_m2, s.covariance_m2());
  s.anchored = s.stands = true;
  s.since_anchor_m = 0;
}

}  // namespace

std::span<const FaultKind> fault_kinds() {
  static const std::vector<FaultKind> kinds = made_kinds();
  return kinds;
}

const FaultKind& kind_of(std::uint64_t number) {
  const auto kinds = fault_kinds();
  return number < kLaterKind ? kinds[number % kFirstKinds] : kinds[kFirstKinds + number / kLaterKind - 1];
}

std::uint64_t number_of(const FaultKind& kind, std::uint64_t repetition) {
  const auto at = static_cast<std::uint64_t>(&kind - fault_kinds().data());
  return at < kFirstKinds ? repetition * kFirstKinds + at : (at - kFirstKinds + 1) * kLaterKind + repetition;
}

bool is_fault_kind(std::string_view code) {
  return std::ranges::any_of(fault_kinds(), [&](const FaultKind& k) { return k.code == code; });
}

const FaultKind& fault_kind(std::string_view code) {
  if (!is_fault_kind(code)) {
    std::string codes;
    for (const FaultKind& kind : fault_kinds()) codes += (codes.empty() ? "" : ", ") + kind.code;
    throw Error({.what = "no such fault", .expected = "one of: " + codes, .found = std::string(code)});
  }
  return *std::ranges::find(fault_kinds(), code, &FaultKind::code);
}

FaultFlight::FaultFlight(const MeasuredLooks& looks, const RepeatRates& repeats, const FaultKind& kind,
                         const FlightLimits& limits, Event target, double wide_starts, Guide guide)
    : looks_(looks),
      repeats_(repeats),
      fault_(kind.fault),
      onset_(kind.onset),
      limits_(limits),
      target_(target),
      wide_starts_(wide_starts),
      guide_(guide),
      picture_(picture_of(kind.fault)),
      grounds_(looks.grounds_with(picture_, kind.fault != FlightFault::unchecked_pairs)) {}

FaultFlight::State FaultFlight::begin(Random& random) const {
  State s;
  s.ground = &grounds_[static_cast<std::size_t>(random.integer(0, static_cast<int>(grounds_.size()) - 1))];
  s.pools = looks_.pools(*s.ground, "clear");
  s.error.tail<2>() = normal_vector(kDriftShare, random);
  if (fault_ == FlightFault::odometry) s.error.tail<2>() += kLongOdometry * random_direction(random);
  s.map_shift_m = normal_vector(parameters::localizer::kMapSigma_m, random);
  double sigma_m = kStartSigma_m;
  const double wide_m = kWideStartFactor * sigma_m;
  s.error.head<2>() = normal_vector(random.chance(wide_starts_) ? wide_m : sigma_m, random);
  s.weight = 1 / (1 - wide_starts_ +
                  wide_starts_ * normal_density(s.error_m(), wide_m) / normal_density(s.error_m(), sigma_m));
  const auto far_off = [&](double least_m, double most_m) {
    sigma_m = kClaimedSigma_m;
    s.weight = 1;
    s.error.head<2>() = random.uniform(least_m, most_m) * random_direction(random);
  };
  if (starts_off(fault_)) fault_ == FlightFault::start_2000 ? far_off(500, 2000) : far_off(150, 500);
  if (fault_ == FlightFault::wrong_anchor) far_off(50, 500);
  s.covariance.diagonal() << sigma_m * sigma_m, sigma_m * sigma_m, kDriftShare * kDriftShare, kDriftShare * kDriftShare;
  s.belief = PlaceBelief(kStartDoubt, square({0, 0}, kArea_m));
  s.minute_ends_s = s.time_s = onset_ == Onset::in_flight ? -60 * kMinutesBefore : 0;
  // Hits at the wrong place, one after the other, until the position is usable: the worst case, because the belief has
  // no memory of the truth.
  for (int i = 0; fault_ == FlightFault::wrong_anchor && i < kMostWrongHits; ++i) {
    const CandidateSigmas sigmas{3, 0, 3};
    LookCandidate wrong{PlanePoint(s.error_m()), sigmas.variance_m2() * Eigen::Matrix2d::Identity(),
                        look_likelihood_table().limit};
    const LookResult result =
        s.belief.update({square(s.error_m(), parameters::search_window::kMinRadius_m), wrong, 1, true},
                        {PlanePoint(s.error_m()), s.covariance_m2(), s.stands});
    if (result.accepted) correct(s, wrong, sigmas, result);
    const auto hpl_m = s.belief.protection_level_m(s.covariance_m2(), limits_.integrity_risk, common_m2(s.anchored));
    if (hpl_m && *hpl_m <= limits_.alert_limit_m) break;
  }
  return s;
}

void FaultFlight::begin_fault(State& s, Random& random) const {
  s.begun = true;
  s.pools = looks_.pools(*s.ground, picture_);
  const double shift_m = fault_ == FlightFault::map_50     ? 50
                         : fault_ == FlightFault::map_200  ? 200
                         : fault_ == FlightFault::map_1000 ? 1000
                                                           : 0;
  s.map_shift_m += shift_m * random_direction(random);
  if (fault_ == FlightFault::foreign_frames) {
    s.foreign_frames = random.integer(1, kMostFrames);
    s.happens_at_s = random.uniform(kHappensFrom_s, kHappensTo_s);
    s.foreign_m = random.uniform(50, 500) * random_direction(random);
  }
  if (fault_ == FlightFault::wrong_motion) {
    s.astray_looks = random.integer(1, kMostFrames);
    s.happens_at_s = random.uniform(kHappensFrom_s, kHappensTo_s);
  }
}

// The look of the wrong motion itself.
void FaultFlight::mislead(State& s, double way_m, Random& random) const {
  const double vague_m = random.uniform(kLeastVague, kMostVague) * way_m;
  const double step_m = kStepShare * way_m;
  const double variance_m2 = vague_m * vague_m + step_m * step_m;
  // From the prediction, in σ: uniform, inside the frame and inside what the prediction allows.
  const double most_m = std::min(std::sqrt(parameters::tracking::kChanceMotion_chi2 * variance_m2), kFootprint_m / 2);
  const Eigen::Vector2d motion_m = most_m * std::sqrt(random.uniform(0, 1)) * random_direction(random);
  const Eigen::Vector2d truth_m = normal_vector(vague_m, random);
  const FlightFilter::MotionFit fit{motion_m.squaredNorm() / variance_m2, variance_m2 * kTurnSigma_rad};
  MotionEvidence evidence;
  evidence.spread = fit.spread;
  evidence.chi2 = fit.chi2;
  evidence.doubt = motion_doubt(fit, kFewInliers, kFrameShape * kFootprint_m * kFootprint_m);
  evidence.covariance_m2 = s.covariance_m2() + vague_m * vague_m * Eigen::Matrix2d::Identity();
  const double seconds = way_m / kSpeed_mps;
  evidence.velocity_mps = -motion_m / seconds;
  evidence.velocity_variance = vague_m * vague_m / (seconds * seconds);
  s.astray_share = (motion_m - truth_m) / way_m;
  s.error.head<2>() += way_m * s.astray_share;
  evidence.predicted = PlanePoint(s.error_m() - motion_m);
  s.belief.on_motion(evidence, {PlanePoint(s.error_m()), s.covariance_m2()});
}

void FaultFlight::advance(State& s, Random& random) const {
  if (!s.begun && s.time_s >= 0) begin_fault(s, random);
  if (s.time_s >= s.minute_ends_s) {
    s.new_ground = std::exp(random.uniform(std::log(kLeastNewGround), 0));
    s.minute_ends_s += 60;
  }
  const bool astray = s.astray_looks > 0 && s.time_s >= s.happens_at_s;
  const bool only_velocity = astray && s.led_astray;  // not the look of the motion itself
  if (astray && !s.led_astray) {
    s.led_astray = true;
    s.new_ground = random.uniform(kSparseGround, 1);
    s.minute_ends_s = s.time_s + 60;
  }
  if (astray) --s.astray_looks;
  const double way_m = s.new_ground * kFootprint_m;
  s.time_s += way_m / kSpeed_mps;
  s.belief.propagate(way_m / kSpeed_mps);
  const bool foreign = s.foreign_frames > 0 && s.time_s >= s.happens_at_s;
  if (foreign) --s.foreign_frames;
  const bool broken = only_velocity || (foreign != s.last_foreign && s.new_ground <= kOverlapSeen);
  s.last_foreign = foreign;
  if (broken && s.anchored) s.stands = false;
  const double step_sigma_m = (broken ? kBrokenStepShare : kStepShare) * way_m;
  Eigen::Matrix4d transition = Eigen::Matrix4d::Identity();
  transition.topRightCorner<2, 2>() = way_m * Eigen::Matrix2d::Identity();
  s.error = transition * s.error;
  if (only_velocity) s.error.head<2>() += way_m * s.astray_share;
  s.error.head<2>() += normal_vector(step_sigma_m, random);
  s.covariance = (transition * s.covariance * transition.transpose()).eval();
  s.covariance.topLeftCorner<2, 2>() += step_sigma_m * step_sigma_m * Eigen::Matrix2d::Identity();
  s.since_anchor_m += way_m;
  if (astray && !only_velocity) mislead(s, way_m, random);
  const bool set_right = s.led_astray && !astray && s.astray_share != Eigen::Vector2d::Zero();
  if (set_right) {  // by the next motion, which the wrong velocity does not explain
    const double vague_m = kBrokenStepShare * way_m;
    MotionEvidence evidence;
    evidence.spread = vague_m * vague_m * kTurnSigma_rad;
    evidence.chi2 = (s.astray_share * way_m).squaredNorm() / (vague_m * vague_m);
    s.belief.on_motion(evidence, {PlanePoint(s.error_m()), s.covariance_m2()});
    s.astray_share.setZero();
  }

  // The look.
  const double radius_m = s.window.radius_m(one_axis_sigma_m(s.covariance_m2()));
  nadir::Look look{square(s.error_m(), radius_m), std::nullopt, s.new_ground, !broken};
  const Eigen::Vector2d shown_m = s.map_shift_m + (foreign ? s.foreign_m : Eigen::Vector2d(0, 0));
  const bool other_map = s.begun && (fault_ == FlightFault::other_map || fault_ == FlightFault::start_and_map);
  const WindowKind window = other_map                      ? WindowKind::other_map
                            : inside(look.window, shown_m) ? WindowKind::holds_place
                                                           : WindowKind::elsewhere;
  CandidateSigmas sigmas;
  const auto candidate_at = [&](const Eigen::Vector2d& position_m, double nats) {
    const double limit = look_likelihood_table().limit;
    look.candidate = LookCandidate{PlanePoint(position_m), sigmas.variance_m2() * Eigen::Matrix2d::Identity(),
                                   std::clamp(nats, -limit, limit)};
  };
  const bool again = s.last_chance && !foreign && inside(look.window, s.last_chance->position.vector()) &&
                     random.chance(repeats_.again(s.new_ground));
  if (again) {
    const RepeatRates::Draw second = repeats_.draw(s.last_chance->log_likelihood_ratio, random);
    sigmas = s.last_chance_sigmas;
    candidate_at(s.last_chance->position.vector() + second.moved_m * random_direction(random),
                 second.log_likelihood_ratio);
    if (s.last_rival) look.rival = moved_with(*s.last_rival, *s.last_chance, *look.candidate);
    s.last_chance = look.candidate;
  } else {
    const LookFinding found = s.pools.draw(window, radius_m, random);
    sigmas = found.sigmas;
    s.last_chance.reset();
    if (found.outcome == LookOutcome::place) {
      const double sigma_m = std::sqrt(sigmas.variance_m2());
      if (!s.place_error_sigmas || !random.chance(repeats_.error_stays(s.new_ground))) {
        s.place_error_sigmas = found.error_m / sigma_m * random_direction(random);
      }
      candidate_at(shown_m + sigma_m * *s.place_error_sigmas, found.log_likelihood_ratio);
    } else if (found.outcome == LookOutcome::chance) {
      const double east_m = random.uniform(look.window.west_m, look.window.east_m),
                   north_m = random.uniform(look.window.south_m, look.window.north_m);
      const Eigen::Vector2d beside_m = shown_m + found.error_m * random_direction(random);
      candidate_at(found.error_m > 0 ? beside_m : Eigen::Vector2d(east_m, north_m), found.log_likelihood_ratio);
      s.last_chance = look.candidate;
      s.last_chance_sigmas = sigmas;
    }
    const bool place = found.outcome == LookOutcome::place;
    if (look.candidate && found.has_rival()) {
      look.rival = rival_of(*look.candidate, found, shown_m, random);
      if (place && s.alike_m && random.chance(repeats_.again(s.new_ground))) {
        look.rival->position = PlanePoint(look.candidate->position.vector() + *s.alike_m);
      }
      const Eigen::Vector2d apart_m = look.rival->position - look.candidate->position;
      if (place || found.rival.error_m > 0) s.alike_m = place ? apart_m : Eigen::Vector2d(-apart_m);
    } else if (place) {
      s.alike_m.reset();
    }
  }
  s.last_rival = look.rival;
  const LookResult result = s.belief.update(look, {PlanePoint(s.error_m()), s.covariance_m2(), s.stands});
  if (result.accepted) correct(s, *look.candidate, sigmas, result);
  s.window.record_attempt(result.accepted ? AnchorVerdict::accepted : AnchorVerdict::few_inliers);

  // What is published.
  s.hpl_m = s.belief.protection_level_m(s.covariance_m2(), limits_.integrity_risk, common_m2(s.anchored));
  if (!s.begun) return;
  ++s.looks;
  if (!s.hpl_m || *s.hpl_m > limits_.alert_limit_m) return;
  ++s.usable;
  s.usable_30 += *s.hpl_m <= 30 ? 1 : 0;
  if (fault_ == FlightFault::wrong_anchor && s.time_s < kWrongAnchorCountsFrom_s) return;
  if (s.error_m().norm() > *s.hpl_m) s.events[misleading] = true;
  if (s.error_m().norm() > limits_.alert_limit_m) s.events[hazardous] = true;
}

double FaultFlight::score(const State& s) const {
  // A wrong start never has more weight than before the first look: no path would be above the others.
  if (starts_off(fault_) && s.looks == 0) return kLeastScore;
  const double far_m = target_ == hazardous ? kFarShare * limits_.alert_limit_m : 0;
  const Eigen::Matrix2d common = common_m2(s.anchored) + far_m * far_m * Eigen::Matrix2d::Identity();
  const auto places = s.belief.place_states(s.covariance_m2());
  double most = kLeastScore;
  const auto weigh = [&](double weight, double others, const Eigen::Vector2d& off_m, const Eigen::Matrix2d& spread_m2) {
    const double at_truth = std::exp(-off_m.squaredNorm() / (2 * larger_eigenvalue(spread_m2 + common)));
    const double against = others + weight * at_truth, wrong = weight * (1 - at_truth);
    if (wrong > 0) most = std::max(most, std::log(wrong / std::max(against, 1e-20)));
  };
  // The others are added up, because what is left of one after a subtraction would be rounding.
  double others = s.belief.elsewhere_probability();
  for (const auto& place : places) others += place.probability;
  weigh(s.belief.track_probability(), others, s.error_m(), s.covariance_m2());
  for (std::size_t i = 0; i < places.size(); ++i) {
    others = s.belief.track_probability() + s.belief.elsewhere_probability();
    for (std::size_t j = 0; j < places.size(); ++j) others += j == i ? 0 : places[j].probability;
    weigh(places[i].probability, others, s.error_m() + places[i].offset_m, places[i].covariance_m2);
  }
  if (guide_ == Guide::doubt) return most;
  const double level_m = std::clamp(s.hpl_m.value_or(kNoLevel_m), limits_.alert_limit_m, kNoLevel_m);
  return most - kWarned * std::log(level_m / limits_.alert_limit_m);
}

}  // namespace nadir::bench
