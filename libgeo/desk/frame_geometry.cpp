#include "desk/frame_geometry.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

namespace nadir {
namespace {

static_assert(kMaxObjectSightings <= parameters::adjustment::kMaxSightings);

constexpr double kMostTurn_rad = 1.0;         // an unknown heading moves a point by its distance, not by more
constexpr double kLeastDown = 0.05;           // of a unit ray: flatter ones show the horizon
constexpr double kMinLogHeightSigma = 0.005;  // keeps the covariance of a pose regular
constexpr double kMaxLogHeightSigma = 1.0;    // beyond it a height is unknown

double squared(double x) { return x * x; }

// Of a ray that goes down: where it meets level ground, east and north of the camera.
std::optional<Eigen::Vector2d> offset_of(const CameraModel& camera, const FrameView& view,
                                         const Eigen::Vector2d& pixel) {
  const Eigen::Vector3d ray = (enu_from_camera(view.camera.pose.attitude) * camera.ray_from_pixel(pixel)).normalized();
  if (!ray.allFinite() || ray.z() > -kLeastDown) return std::nullopt;
  return Eigen::Vector2d(ray.head<2>() * (view.camera.pose.agl_m / -ray.z()));
}

std::optional<Estimate> best_estimate(const FlightStore& store, std::size_t frame, EstimateKind& kind) {
  for (const EstimateKind each : {EstimateKind::adjusted, EstimateKind::refined, EstimateKind::online}) {
    auto found = store.estimates(each, frame, 1);
    if (found.empty() || !found.front().position) continue;
    kind = each;
    return std::move(found.front());
  }
  return std::nullopt;
}

std::string explained(LocationProblem problem) {
  switch (problem) {
    case LocationProblem::above_horizon: return "its pixel shows the sky";
    case LocationProblem::no_ground: return "the ray through its pixel meets no ground within 20 km";
    case LocationProblem::diverging: return "its sightings do not meet: mark the same point in each picture";
  }
  return {};
}

}  // namespace

FlightGround::FlightGround(const FlightStore& store, std::shared_ptr<const DeskPackage> package)
    : package_(std::move(package)),
      plane_(package_ ? package_->frame : LocalFrame(store.description().session.origin)) {}

const GroundSurface& FlightGround::surface() const {
  if (package_ && package_->surface) return *package_->surface;
  return flat_;
}

FrameView view_of(const FlightStore& store, const FlightGround& ground, std::size_t frame) {
  FrameView view;
  const StateEstimate state = store.stored_frame(frame).online.state;
  const Telemetry telemetry = store.picture(frame).telemetry;
  const double tilt_sigma_rad = store.description().session.camera.uncertainty.tilt_rad;
  CameraPose& pose = view.camera.pose;
  pose.agl_m = state.agl_m;
  pose.attitude = {state.heading_rad, telemetry.pitch_rad.value_or(0), telemetry.roll_rad.value_or(0)};
  view.heading_sigma_rad = state.heading_sigma_rad;
  view.tilt_sigma_rad = tilt_sigma_rad;
  view.agl_sigma_m = state.agl_sigma_m;

  Eigen::Matrix<double, 6, 6> of_filter = Eigen::Matrix<double, 6, 6>::Zero();
  if (const auto estimate = best_estimate(store, frame, view.kind)) {
    view.placed = true;
    pose.position = ground.plane().plane_from_lonlat(*estimate->position);
    of_filter.topLeftCorner<2, 2>() = estimate->covariance_m2;
  }
  const double log_height_sigma = state.agl_sigma_m / std::max(1.0, state.agl_m);
  of_filter(2, 2) = squared(std::clamp(log_height_sigma, kMinLogHeightSigma, kMaxLogHeightSigma));
  of_filter(3, 3) = squared(std::min(state.heading_sigma_rad, kMostTurn_rad));
  of_filter(4, 4) = of_filter(5, 5) = squared(tilt_sigma_rad);
  view.camera.covariance = pose_covariance(pose, of_filter);
  return view;
}

std::optional<std::array<Eigen::Vector2d, 4>> footprint(const CameraModel& camera, const FrameView& view) {
  const double right = camera.width - 0.5, bottom = camera.height - 0.5;  // the outer edges of the last pixels
  const std::array<Eigen::Vector2d, 4> pixels{Eigen::Vector2d(-0.5, -0.5), Eigen::Vector2d(right, -0.5),
                                              Eigen::Vector2d(right, bottom), Eigen::Vector2d(-0.5, bottom)};
  std::array<Eigen::Vector2d, 4> corners;
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const auto offset = offset_of(camera, view, pixels.at(i));
    if (!offset) return std::nullopt;
    corners.at(i) = *offset;
  }
  return corners;
}

std::optional<SearchHint> aircraft_at(const CameraModel& camera, const FrameView& view, const PixelPoint& pixel,
                                      const LonLat& place, double sigma_m) {
  const auto offset = offset_of(camera, view, {pixel.x, pixel.y});
  if (!offset) return std::nullopt;
  const double away_m = offset->norm(), agl_m = std::max(1.0, view.camera.pose.agl_m);
  const double variance_m2 = squared(sigma_m) + squared(away_m * std::min(view.heading_sigma_rad, kMostTurn_rad)) +
                             squared((agl_m + squared(away_m) / agl_m) * view.tilt_sigma_rad) +
                             squared(away_m * view.agl_sigma_m / agl_m);
  const LocalFrame around(place);
  return SearchHint{around.lonlat_from_plane({-offset->x(), -offset->y()}), kHintRadiusSigmas * std::sqrt(variance_m2)};
}

std::variant<PlacedObject, std::string> place_of(const MarkedObject& object, const FlightStore& store,
                                                 const FlightGround& ground) {
  std::map<std::size_t, std::size_t> index_of;  // frame number to its place in `frames`
  std::vector<SightedFrame> frames;
  std::vector<ObjectSighting> sightings;
  for (const MarkedSighting& marked : object.sightings) {
    const auto [found, fresh] = index_of.emplace(marked.frame, frames.size());
    if (fresh) {
      const FrameView view = view_of(store, ground, marked.frame);
      if (!view.placed) return fmt::format("the position of frame {} is not known", marked.frame);
      frames.push_back(view.camera);
    }
    sightings.push_back({.frame = found->second, .pixel = {marked.pixel.x, marked.pixel.y}});
  }
  const auto located =
      place_object(store.description().session.camera.camera, ground.surface(), frames, sightings,
                   std::max(parameters::adjustment::kTerrainSigma_m, ground.surface().relief_sigma_m()));
  if (const auto* problem = std::get_if<LocationProblem>(&located)) return explained(*problem);
  const auto& placed = std::get<LocatedObject>(located);
  return PlacedObject{ground.plane().lonlat_from_plane(placed.place), placed.height_m, placed};
}

}  // namespace nadir
