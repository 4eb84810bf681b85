#include "navigability/protection_forecast.hpp"

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <utility>

#include "base/normal_distribution.hpp"
#include "base/ordered_work.hpp"
#include "base/quantile.hpp"
#include "base/random.hpp"
#include "estimation/belief.hpp"
#include "estimation/flight_process_model.hpp"
#include "estimation/look_likelihood.hpp"
#include "estimation/map_look.hpp"
#include "estimation/pose_measurements.hpp"
#include "estimation/search_window.hpp"
#include "navigability/navigability_parameters.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {
using namespace parameters::navigability;
namespace {

namespace look = parameters::anchor_measurement;
namespace odometry = parameters::visual_odometry;
namespace tracking = parameters::tracking;

double squared(double x) { return x * x; }
double logit(double p) { return std::log(p / (1 - p)); }

// One axis of the flight filter, the same for both, and how far off each of them is.
class AxisFilter {
 public:
  using Error = Eigen::Matrix<double, 3, 2>;  // of position, velocity and odometry's drift; east and north

  AxisFilter(const TelemetryUncertainty& uncertainty, const Eigen::Vector2d& velocity_mps, Random& random)
      : uncertainty_(uncertainty) {
    const double drift = std::sqrt((squared(uncertainty.heading_rad) + squared(uncertainty.agl_relative)) / 2);
    covariance_.diagonal() << squared(parameters::localizer::kStartSigma_m),
        squared(FlightFilterOptions{}.start_velocity_sigma_mps), squared(drift);
    error_.row(0) = normal_row(kStartError_m, random);
    error_.row(1) = -velocity_mps.transpose();  // nothing is known of it yet
    error_.row(2) = normal_row(drift, random);
  }

  void propagate(const ForecastFrame& frame, bool tracked, Random& random) {
    const double dt = frame.seconds, way_m = frame.way_m;
    const double change = squared(imu_dv_sigma_mps(uncertainty_, blind_s_, dt)) * dt +
                          squared(uncertainty_.heading_rad * frame.turn_rad) * squared(way_m / dt);
    blind_s_ = tracked ? 0 : blind_s_ + dt;
    const double noise_m2 = squared(odometry::kModelErrorShare * way_m) +
                            squared(odometry::kTurnErrorShare * frame.turn_rad * way_m) +
                            squared(parameters::two_view_motion::kPixelHeightShare * frame.agl_m);
    const auto changed = normal_row(std::sqrt(change), random), measured = normal_row(std::sqrt(noise_m2), random);

    // Together with the position before.
    Eigen::Matrix<double, 4, 3> transition = Eigen::Matrix<double, 4, 3>::Zero();
    transition.topRows<3>().setIdentity();
    transition(0, 1) = dt;
    transition(3, 0) = 1;
    Eigen::Matrix4d joint = transition * covariance_ * transition.transpose();
    joint(0, 0) += change * dt * dt / 4;
    joint(0, 1) += change * dt / 2;
    joint(1, 0) += change * dt / 2;
    joint(1, 1) += change;
    Eigen::Matrix<double, 4, 2> error = transition * error_;
    error.row(0) += changed * dt / 2;
    error.row(1) += changed;
    if (tracked) {
      const Eigen::RowVector4d row(1, 0, way_m, -1);
      const Eigen::Vector4d gain = joint * row.transpose() / ((row * joint * row.transpose()).value() + noise_m2);
      error += gain * (measured - row * error).eval();
      joint -= gain * (row * joint).eval();
    }
    covariance_ = joint.topLeftCorner<3, 3>();
    error_ = error.topRows<3>();
  }

  void inflate(double variance_m2) { covariance_(0, 0) += variance_m2; }

  // measured_m: how far off the measurement is. Returns how the position moves.
  Eigen::Vector2d update(const Eigen::Vector2d& measured_m, double variance_m2, double association_doubt) {
    using Variance = Eigen::Matrix<double, 1, 1>;
    const Variance measured(variance_m2), predicted(covariance_(0, 0));
    const double weighted_m2 = weighted_by_association(measured, association_doubt, predicted).value();
    const Eigen::Vector3d gain = covariance_.col(0) / (covariance_(0, 0) + weighted_m2);
    const Eigen::RowVector2d innovation = measured_m.transpose() - error_.row(0);
    error_ += gain * innovation;
    covariance_ -= (gain * covariance_.row(0)).eval();
    blind_s_ = 0;
    return gain[0] * innovation.transpose();
  }

  Eigen::Vector2d error_m() const { return error_.row(0).transpose(); }
  double variance_m2() const { return covariance_(0, 0); }
  double velocity_sigma_mps() const { return std::sqrt(covariance_(1, 1)); }
  Eigen::Matrix2d position_covariance_m2() const { return variance_m2() * Eigen::Matrix2d::Identity(); }

 private:
  static Eigen::RowVector2d normal_row(double sigma, Random& random) {
    const double east = random.normal(0, sigma), north = random.normal(0, sigma);
    return {east, north};
  }

  TelemetryUncertainty uncertainty_;
  double blind_s_ = 0;  // since the velocity was last measured
  Eigen::Matrix3d covariance_ = Eigen::Matrix3d::Zero();
  Error error_ = Error::Zero();
};

// How likely odometry tracks a frame, by how much of it the one before shows.
double tracked_probability(const ForecastFrame& frame) {
  if (frame.bare) return 0;
  const double overlap = 1 - frame.way_m / frame.along_m;
  return std::clamp((overlap - kLeastTrackedOverlap) / (kSureTrackedOverlap - kLeastTrackedOverlap), 0.0, 1.0);
}

class DrawnFlight {
 public:
  DrawnFlight(const ForecastSetup& setup, const Eigen::Vector2d& velocity_mps, Random random)
      : setup_(setup),
        random_(std::move(random)),
        filter_(setup.uncertainty, velocity_mps, random_),
        belief_(parameters::belief::kStartDoubt, setup.area),
        window_(parameters::search_window::kMinRadius_m, parameters::search_window::kMaxRadius_m, setup.area) {}

  struct Moment {
    float hpl_m, since_anchor_m;  // infinite: no level
    bool anchored;
  };
  Moment fly(const ForecastFrame& frame) {
    broken_ = false;
    if (frame.way_m > 0) {
      const bool tracked = random_.chance(tracked_probability(frame));
      filter_.propagate(frame, tracked, random_);
      // As TrackingState has it.
      const double reach_m = frame.way_m + tracking::kOverlapSpeedSigmas * filter_.velocity_sigma_mps() * frame.seconds;
      broken_ = linked_ && !tracked && reach_m < tracking::kOverlapReachShare * frame.footprint_m;
      linked_ = tracked;
      belief_.propagate(frame.seconds);
      unbroken_ = unbroken_ && tracked;
      since_anchor_m_ += frame.way_m;
    }
    match(frame);
    const double common_m2 = anchored_ ? squared(frame.map_sigma_m) + unmodelled_variance_m2(frame.agl_m) : 0;
    const auto hpl_m = belief_.protection_level_m(filter_.position_covariance_m2(), setup_.integrity_risk,
                                                  common_m2 * Eigen::Matrix2d::Identity());
    return {static_cast<float>(hpl_m.value_or(std::numeric_limits<double>::infinity())),
            static_cast<float>(since_anchor_m_), since_anchor_m_ == 0 && anchored_};
  }

 private:
  struct Candidate {
    LookCandidate candidate;
    double solved_variance_m2, wrong_consensus_m2;
  };

  Candidate candidate_at(const PlanePoint& position, double evidence, const ForecastFrame& frame) const {
    const double limit = look_likelihood_table().limit;
    Candidate at;
    at.candidate.log_likelihood_ratio = std::clamp(evidence, -limit, limit);
    at.solved_variance_m2 = squared(kSolvedShare * frame.agl_m);
    at.wrong_consensus_m2 =
        evidence >= kMostPatchesEvidence ? 0 : squared(look::kWrongConsensusSigma_px * frame.fine_gsd_m);
    at.candidate.covariance_m2 = (at.solved_variance_m2 + at.wrong_consensus_m2 + unmodelled_variance_m2(frame.agl_m)) *
                                 Eigen::Matrix2d::Identity();
    at.candidate.position = position;
    return at;
  }

  std::optional<Candidate> draw(const ForecastFrame& frame, const PlaneBox& window) {
    const double kept = std::exp(-frame.way_m / kLookCorrelation_m);
    const double fresh = random_.normal();
    ground_ = first_ ? fresh : kept * ground_ + std::sqrt(1 - kept * kept) * fresh;
    // Drawn in any case, so that a look that fails elsewhere does not change those after it.
    const double share = std::clamp(normal_share_below(ground_), 1e-9, 1 - 1e-9), scatter = random_.normal();
    const double east = random_.normal(), north = random_.normal();
    const double across = random_.uniform(), up = random_.uniform(), chance = random_.uniform();
    const double margin = logit(std::min(frame.probability, 1 - 1e-9)) - logit(share);
    lost_ = lost_ || window_.lost(true, std::sqrt(filter_.variance_m2()));
    if (!lost_ && frame.probability > 0 && margin > -kFoundLogit) {
      const double evidence = kEvidenceOffset + kEvidencePerLogit * margin + kEvidenceScatter * scatter;
      const Candidate expected = candidate_at(frame.place, evidence, frame);
      const double off_m = std::sqrt(expected.candidate.covariance_m2(0, 0));
      return candidate_at({frame.place.east_m + off_m * east, frame.place.north_m + off_m * north}, evidence, frame);
    }
    if (frame.probability <= 0 || chance >= kChancePeak) return std::nullopt;
    return candidate_at({window.west_m + across * (window.east_m - window.west_m),
                         window.south_m + up * (window.north_m - window.south_m)},
                        kChanceEvidence + kChanceEvidenceScatter * scatter, frame);
  }

  void match(const ForecastFrame& frame) {
    const PlanePoint track(frame.place.vector() + filter_.error_m());
    const PlaneBox window = square_around(track, window_.radius_m(std::sqrt(filter_.variance_m2())));
    const auto drawn = draw(frame, window);
    const double new_ground = first_ ? 1 : std::min(1.0, frame.way_m / frame.footprint_m);
    first_ = false;
    Look seen{window, std::nullopt, new_ground, !broken_};
    if (drawn) seen.candidate = drawn->candidate;
    const Eigen::Matrix2d before_m2 = filter_.position_covariance_m2();
    const LookResult result = belief_.update(seen, {track, before_m2, unbroken_});
    window_.record_attempt(result.accepted ? AnchorVerdict::accepted : AnchorVerdict::few_inliers);
    if (!result.accepted) return;
    const Eigen::Vector2d measured_m = drawn->candidate.position - frame.place;
    if (result.contradicted) filter_.inflate((drawn->candidate.position - track).squaredNorm());
    const double shared =
        anchored_ ? std::max(1.0, look::kSharedErrorFootprints * frame.footprint_m / std::max(1.0, since_anchor_m_))
                  : 1;
    double variance_m2 = drawn->solved_variance_m2 * shared;
    const Eigen::Matrix2d innovation_m2 =
        filter_.position_covariance_m2() +
        (variance_m2 + unmodelled_variance_m2(frame.agl_m)) * Eigen::Matrix2d::Identity();
    variance_m2 += wrong_consensus_left_m2(drawn->wrong_consensus_m2, innovation_m2, measured_m - filter_.error_m());
    const Eigen::Vector2d by_m = filter_.update(measured_m, variance_m2, result.association_doubt);
    belief_.on_anchor(by_m, before_m2, filter_.position_covariance_m2());
    anchored_ = unbroken_ = true;
    since_anchor_m_ = 0;
  }

  const ForecastSetup& setup_;
  Random random_;
  AxisFilter filter_;
  PlaceBelief belief_;
  SearchWindow window_;
  double ground_ = 0;  // the latent variable of the looks
  double since_anchor_m_ = 0;
  bool first_ = true, anchored_ = false, unbroken_ = true, lost_ = false;
  bool linked_ = true, broken_ = false;  // this frame to the last one
};

}  // namespace

std::vector<ForecastLevel> forecast_levels(std::span<const ForecastFrame> frames, const ForecastSetup& setup,
                                           Progress& progress) {
  using Flight = std::vector<DrawnFlight::Moment>;
  std::vector<Flight> flights;
  const Eigen::Vector2d velocity_mps = frames.size() > 1
                                           ? Eigen::Vector2d((frames[1].place - frames[0].place) / frames[1].seconds)
                                           : Eigen::Vector2d::Zero();
  const auto make_worker = [&]() -> std::function<Flight(std::size_t)> {
    return [&](std::size_t number) {
      DrawnFlight drawn(setup, velocity_mps, Random(kForecastSeed).fork("flight", number));
      Flight flight;
      flight.reserve(frames.size());
      for (const ForecastFrame& frame : frames) flight.push_back(drawn.fly(frame));
      return flight;
    };
  };
  progress.begin("drawing flights", kDrawnFlights, "flights");
  work_in_order<Flight>(kDrawnFlights, setup.threads, make_worker, [&](std::size_t, Flight flight) {
    flights.push_back(std::move(flight));
    progress.advance();
    return true;
  });
  progress.end();

  std::vector<ForecastLevel> levels;
  std::vector<float> hpl_m(flights.size()), since_m(flights.size());
  for (std::size_t i = 0; i < frames.size(); ++i) {
    std::size_t beyond = 0, anchored = 0;
    for (std::size_t k = 0; k < flights.size(); ++k) {
      hpl_m[k] = flights[k][i].hpl_m;
      since_m[k] = flights[k][i].since_anchor_m;
      if (static_cast<double>(hpl_m[k]) > setup.alert_limit_m) ++beyond;
      if (flights[k][i].anchored) ++anchored;
    }
    ForecastLevel level;
    const double most_m = static_cast<double>(quantile(hpl_m, kProtectionShare));
    if (std::isfinite(most_m)) level.hpl_m = most_m;
    level.beyond_share = static_cast<double>(beyond) / static_cast<double>(flights.size());
    level.anchored_share = static_cast<double>(anchored) / static_cast<double>(flights.size());
    level.since_anchor_m = static_cast<double>(quantile(since_m, kProtectionShare));
    levels.push_back(level);
  }
  return levels;
}

}  // namespace nadir
