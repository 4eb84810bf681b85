#include "desk/frame_geometry.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "flights/picture_at_one_moment.hpp"
#include "geodesy/hypotenuse.hpp"

namespace nadir {
namespace {

static_assert(kMaxObjectSightings <= parameters::adjustment::kMaxSightings);

constexpr double kMostTurn_rad = 1.0;         // an unknown heading moves a point by its distance, not by more
constexpr double kLeastDown = 0.05;           // of a unit ray: flatter ones show the horizon
constexpr double kMinLogHeightSigma = 0.005;  // keeps the covariance of a pose regular
constexpr double kMaxLogHeightSigma = 1.0;    // beyond it a height is unknown

double squared(double x) { return x * x; }

// Of a ray that goes down: where it meets level ground, east and north of the camera.
std::optional<Eigen::Vector2d> offset_of(const FrameView& view, const Eigen::Vector2d& pixel) {
  const Eigen::Matrix3d enu = enu_from_camera(view.camera.pose.attitude);
  const Eigen::Vector3d ray = (enu * view.lens.ray_from_pixel(pixel)).normalized();
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
  const auto pose = store.adjusted_pose(frame);
  const auto lens = store.adjusted_lens();
  const auto adjusted = store.estimates(EstimateKind::adjusted, frame, 1);
  if (!pose || !lens || adjusted.empty() || !adjusted.front().position) return processed_view_of(store, ground, frame);
  FrameView view;
  view.lens = lens->applied_to(store.description().session.camera.camera);
  view.placed = view.adjusted = true;
  view.kind = EstimateKind::adjusted;
  view.camera.pose = {ground.plane().plane_from_lonlat(*adjusted.front().position), pose->agl_m, pose->attitude};
  view.camera.covariance = pose->covariance;
  const auto sigma = [&](int parameter) { return std::sqrt(std::max(0.0, pose->covariance(parameter, parameter))); };
  view.agl_sigma_m = sigma(2);
  view.tilt_sigma_rad = hypotenuse(sigma(3), sigma(4)) / std::numbers::sqrt2;
  view.heading_sigma_rad = sigma(5);  // about the optical axis
  return view;
}

FrameView processed_view_of(const FlightStore& store, const FlightGround& ground, std::size_t frame) {
  FrameView view;
  view.lens = store.description().session.camera.camera;
  StateEstimate state = store.stored_frame(frame).online.state;
  if (const auto placed = store.placed_estimate(frame); placed && placed->state.agl_m > 0) state = placed->state;
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

std::optional<std::array<Eigen::Vector2d, 4>> footprint(const FrameView& view) {
  const CameraModel& camera = view.lens;
  const double right = camera.width - 0.5, bottom = camera.height - 0.5;  // the outer edges of the last pixels
  const std::array<Eigen::Vector2d, 4> pixels{Eigen::Vector2d(-0.5, -0.5), Eigen::Vector2d(right, -0.5),
                                              Eigen::Vector2d(right, bottom), Eigen::Vector2d(-0.5, bottom)};
  std::array<Eigen::Vector2d, 4> corners;
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const auto offset = offset_of(view, pixels.at(i));
    if (!offset) return std::nullopt;
    corners.at(i) = *offset;
  }
  return corners;
}

std::optional<SearchHint> aircraft_at(const FrameView& view, const PixelPoint& pixel, const LonLat& place,
                                      double sigma_m) {
  const auto offset = offset_of(view, {pixel.x, pixel.y});
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
  std::map<std::size_t, std::size_t> index_of;  // frame number to its place in `numbers`
  std::vector<std::size_t> numbers;
  std::vector<ObjectSighting> sightings;
  for (const MarkedSighting& marked : object.sightings) {
    const auto [found, fresh] = index_of.emplace(marked.frame, numbers.size());
    if (fresh) numbers.push_back(marked.frame);
    const Eigen::Vector2d pixel =
        pixel_at_one_moment(store, marked.frame, store.description().session.camera, {marked.pixel.x, marked.pixel.y});
    sightings.push_back({.frame = found->second, .pixel = pixel});
  }
  std::vector<FrameView> views;
  for (const std::size_t frame : numbers) views.push_back(view_of(store, ground, frame));
  // One lens, and one kind of pose: adjusted ones have errors in common that the others do not share.
  const bool adjusted = std::all_of(views.begin(), views.end(), [](const FrameView& view) { return view.adjusted; });
  std::vector<SightedFrame> frames;
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    if (!adjusted && views[i].adjusted) views[i] = processed_view_of(store, ground, numbers[i]);
    if (!views[i].placed) return fmt::format("the position of frame {} is not known", numbers[i]);
    frames.push_back(views[i].camera);
  }
  std::optional<Eigen::MatrixXd> joint;
  if (adjusted) joint = store.adjusted_joint_covariance(numbers);
  const auto located =
      place_object(views.front().lens, ground.surface(), frames, sightings,
                   std::max(parameters::adjustment::kTerrainSigma_m, ground.surface().relief_sigma_m()), joint);
  if (const auto* problem = std::get_if<LocationProblem>(&located)) return explained(*problem);
  const auto& placed = std::get<LocatedObject>(located);
  return PlacedObject{ground.plane().lonlat_from_plane(placed.place), placed.height_m, placed, adjusted};
}

}  // namespace nadir
