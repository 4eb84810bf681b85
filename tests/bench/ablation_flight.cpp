#include "ablation_flight.hpp"

#include <Eigen/Core>
#include <cmath>
#include <limits>

#include "base/random.hpp"
#include "replay/flight_folder.hpp"
#include "replay/score.hpp"
#include "vision/camera_frame.hpp"

namespace nadir::bench {
namespace {

constexpr std::size_t kLeastSegment = 5;  // frames: shorter ones have no drift to speak of

Eigen::Vector2d at(const LocalFrame& frame, const LonLat& place) { return frame.plane_from_lonlat(place).vector(); }

double off_m(const std::optional<PlanePoint>& camera, const std::optional<LonLat>& truth, const LocalFrame& frame) {
  return camera && truth ? (*camera - frame.plane_from_lonlat(*truth)).norm() : 0;
}

struct Track {
  std::vector<Eigen::Vector2d> estimated, truth;
};

// Sum of squares after the best turn and shift of the track onto the truth; in the plane both have closed forms.
double rigid_squares(const Track& track) {
  const auto n = static_cast<double>(track.estimated.size());
  Eigen::Vector2d middle = Eigen::Vector2d::Zero(), truth = Eigen::Vector2d::Zero();
  for (std::size_t i = 0; i < track.estimated.size(); ++i) {
    middle += track.estimated[i] / n;
    truth += track.truth[i] / n;
  }
  double squares = 0, along = 0, across = 0;
  for (std::size_t i = 0; i < track.estimated.size(); ++i) {
    const Eigen::Vector2d a = track.estimated[i] - middle, b = track.truth[i] - truth;
    squares += a.squaredNorm() + b.squaredNorm();
    along += a.dot(b);
    across += a.x() * b.y() - a.y() * b.x();
  }
  return std::max(0.0, squares - 2 * std::hypot(along, across));
}

double length_m(const std::vector<Eigen::Vector2d>& points) {
  double length = 0;
  for (std::size_t i = 1; i < points.size(); ++i) length += (points[i] - points[i - 1]).norm();
  return length;
}

}  // namespace

RecordedFlight recorded_flight(const FlightPaths& paths, const std::filesystem::path& truth) {
  RecordedFlight recorded{read_flight(paths), {}, {}, {}};
  recorded.truth = read_truth(truth, recorded.flight.frames);
  recorded.camera = recorded.flight.camera;
  const int shrink = decode_reduction(recorded.camera.camera.width, recorded.camera.camera.height);
  recorded.camera.camera = recorded.camera.camera.scaled(1.0 / shrink);
  for (const Telemetry& telemetry : recorded.flight.frames) {
    recorded.pictures.push_back(read_grey_image(recorded.flight.frames_folder / telemetry.frame, shrink));
  }
  return recorded;
}

MatchingFigures fly(const RecordedFlight& recorded, const FlownMap& map, const MapMatcherFactory& matcher,
                    std::optional<LonLat> start) {
  MatchingFigures figures;
  LocalizerConfig config = map.config;
  config.matcher = timed(matcher, figures.attempt_ms);
  Localizer localizer(recorded.camera, map.frame, &map.tiles, start, config);
  for (std::size_t i = 0; i < recorded.pictures.size(); ++i) {
    const FrameReport report = localizer.process(recorded.pictures[i], recorded.flight.frames[i]);
    const auto& truth = recorded.truth[i];
    ++figures.frames;
    const bool wrong = off_m(report.anchor.camera, truth, map.frame) > kWrongAnchor_m;
    if (report.anchor.verdict == AnchorVerdict::accepted) {
      ++figures.anchored;
      if (wrong) ++figures.wrong;
      if (const auto error = errors_m({report.estimate}, {truth}, map.frame).front()) figures.error_m.push_back(*error);
    } else if (report.anchor.verdict == AnchorVerdict::awaiting_votes) {
      ++figures.awaiting;
      if (wrong) ++figures.awaiting_wrong;
    }
  }
  return figures;
}

SearchFigures search(const RecordedFlight& recorded, const FlownMap& map, const MapMatcherFactory& make,
                     double radius_m, std::size_t every) {
  SearchFigures figures;
  const FlatGround flat;
  const GroundSurface& surface = map.config.surface != nullptr ? *map.config.surface : flat;
  const auto matcher = timed(make, figures.attempt_ms)({recorded.camera.camera, map.tiles, map.frame, surface});
  const TelemetryUncertainty& sigma = recorded.camera.uncertainty;
  Random random(1);
  for (std::size_t i = 0; i < recorded.pictures.size(); i += every) {
    if (recorded.pictures[i].empty() || !recorded.truth[i]) continue;
    const Telemetry& telemetry = recorded.flight.frames[i];
    const Eigen::Vector2d truth = at(map.frame, *recorded.truth[i]);
    AnchorPrior prior;
    CameraPose& pose = prior.search.pose;
    pose.position = {truth.x() + random.uniform(-0.8, 0.8) * radius_m,
                     truth.y() + random.uniform(-0.8, 0.8) * radius_m};
    pose.agl_m = telemetry.agl_m.value_or(map.config.assumed_agl_m);
    pose.attitude = {telemetry.heading_rad.value_or(0), telemetry.pitch_rad.value_or(0),
                     telemetry.roll_rad.value_or(0)};
    prior.search.radius_m = radius_m;
    prior.search.heading_range_rad = 3 * sigma.heading_rad;
    prior.search.scale_range = 2.5 * sigma.agl_relative;
    prior.heading_sigma_rad = sigma.heading_rad;
    prior.log_agl_sigma = sigma.agl_relative;
    prior.tilt_covariance_rad2 = Eigen::Matrix2d::Identity() * sigma.tilt_rad * sigma.tilt_rad;
    const AnchorMatch match = matcher->match(recorded.pictures[i], prior);
    ++figures.frames;
    figures.ratio.push_back(match.search.ratio);
    if (match.search.places.empty()) continue;
    if (off_m(match.search.places.front().pose.position, recorded.truth[i], map.frame) <= kWrongAnchor_m)
      ++figures.right;
  }
  return figures;
}

DriftFigures drift(const RecordedFlight& recorded, const OdometryFactory& odometry) {
  DriftFigures figures;
  const LonLat start = recorded.truth.front().value();
  const LocalFrame frame(start);
  LocalizerConfig config;
  config.odometry = timed(odometry, figures.step_ms);
  config.no_fix_sigma_m = std::numeric_limits<double>::max();  // a segment's shape counts, wherever it lies
  Localizer localizer(recorded.camera, frame, nullptr, start, config);
  std::vector<Track> segments;
  for (std::size_t i = 0; i < recorded.pictures.size(); ++i) {
    const FrameReport report = localizer.process(recorded.pictures[i], recorded.flight.frames[i]);
    ++figures.frames;
    if (report.odometry.tracked) ++figures.tracked;
    if (!report.odometry.tracked || segments.empty()) segments.emplace_back();
    if (!report.estimate.position || !recorded.truth[i]) continue;
    segments.back().estimated.push_back(at(frame, *report.estimate.position));
    segments.back().truth.push_back(at(frame, *recorded.truth[i]));
  }
  double error_m = 0, path_m = 0;
  for (const Track& track : segments) {
    if (track.estimated.size() < kLeastSegment) continue;
    error_m += std::sqrt(rigid_squares(track) / static_cast<double>(track.estimated.size()));
    path_m += length_m(track.truth);
  }
  if (path_m > 0) figures.drift_share = error_m / path_m;
  return figures;
}

}  // namespace nadir::bench
