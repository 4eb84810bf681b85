#include "api/requests.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "api/object_location.hpp"
#include "geodesy/angles.hpp"
#include "http/json_body.hpp"
#include "service/onboard_event.hpp"
#include "service/service_rules.hpp"

namespace nadir {
namespace {

constexpr NumberRange kTurn_deg{.low = -360, .high = 360};
constexpr NumberRange kTilt_deg{.low = -90, .high = 90};
constexpr int kMaxSide_px = 20'000;

struct ObjectRequest {
  CameraModel camera;
  Eigen::Vector2d pixel{0, 0};
  std::optional<double> zoom;
  std::optional<GimbalAngles> gimbal;
  std::optional<AircraftPose> pose;
};

Eigen::Vector2d parse_pixel(BodyFields& body, FieldErrors& errors) {
  std::optional<BodyFields> pixel = body.optional_object("pixel");
  if (!pixel) {
    errors.push_back({"/pixel", "is missing"});
    return {0, 0};
  }
  const NumberRange side{.low = -0.5, .high = kMaxSide_px};
  const Eigen::Vector2d place(pixel->number("x", side), pixel->number("y", side));
  pixel->finish();
  return place;
}

// fx and fy at zoom 1; the principal point is the image centre unless it is given.
CameraModel parse_camera(BodyFields& body, std::optional<double>& zoom, FieldErrors& errors) {
  CameraModel model;
  std::optional<BodyFields> camera = body.optional_object("camera");
  if (!camera) {
    errors.push_back({"/camera", "is missing"});
    return model;
  }
  const NumberRange focal_px{.low = 1, .high = 1e6};
  const NumberRange side{.low = -0.5, .high = kMaxSide_px};
  model.width = camera->integer("width", 1, kMaxSide_px);
  model.height = camera->integer("height", 1, kMaxSide_px);
  model.fx = camera->number("fx", focal_px);
  model.fy = camera->optional_number("fy", focal_px).value_or(model.fx);
  model.cx = camera->optional_number("cx", side).value_or(0.5 * (model.width - 1));
  model.cy = camera->optional_number("cy", side).value_or(0.5 * (model.height - 1));
  const std::vector<double> distortion = camera->optional_numbers("distortion", 5, {.low = -10, .high = 10});
  std::copy(distortion.begin(), distortion.end(), model.distortion.begin());
  zoom = camera->optional_number("zoom", {.low = 0.1, .high = 200});
  camera->finish();
  return model;
}

std::optional<GimbalAngles> parse_gimbal(BodyFields& body) {
  std::optional<BodyFields> fields = body.optional_object("gimbal");
  if (!fields) return std::nullopt;
  GimbalAngles gimbal;
  gimbal.pitch_rad = radians(fields->number("pitch_deg", {.low = -180, .high = 90}));
  gimbal.yaw_rad = radians(fields->optional_number("yaw_deg", kTurn_deg).value_or(0));
  gimbal.roll_rad = radians(fields->optional_number("roll_deg", kTurn_deg).value_or(0));
  gimbal.from_horizon = fields->optional_word("reference", {"airframe", "horizon"}) == "horizon";
  fields->finish();
  return gimbal;
}

std::optional<AircraftPose> parse_pose(BodyFields& body) {
  std::optional<BodyFields> fields = body.optional_object("pose");
  if (!fields) return std::nullopt;
  AircraftPose pose;
  pose.place.lat_deg = fields->number("lat", {.low = -85, .high = 85});
  pose.place.lon_deg = fields->number("lon", {.low = -180, .high = 180});
  pose.agl_m = fields->number("agl_m", {.low = 0, .high = 10'000, .above_low = true});
  pose.attitude.heading_rad = radians(fields->number("heading_deg", kTurn_deg));
  pose.attitude.pitch_rad = radians(fields->number("pitch_deg", kTilt_deg));
  pose.attitude.roll_rad = radians(fields->number("roll_deg", {.low = -180, .high = 180}));
  pose.sigma_m = fields->number("sigma_m", {.low = 0, .high = 100'000});
  fields->finish();
  return pose;
}

std::variant<AircraftPose, Problem> own_pose(const FlightView& view) {
  const auto missing = [](const char* what) {
    return Problem{.status = 422,
                   .type = "pose-missing",
                   .detail = std::string("the service itself has no ") + what + " now; send \"pose\", or ask again"};
  };
  if (!view.position || !is_visual(view.source)) return missing("visual position");
  if (!view.agl_m || !(*view.agl_m > 0)) return missing("height above ground");
  if (!view.heading_rad || !view.pitch_rad || !view.roll_rad) return missing("attitude");
  return AircraftPose{.place = view.position->place,
                      .agl_m = *view.agl_m,
                      .attitude = {*view.heading_rad, *view.pitch_rad, *view.roll_rad},
                      .sigma_m = view.position->sigma_m};
}

Problem refused(std::string type, std::string detail) {
  return {.status = 422, .type = std::move(type), .detail = std::move(detail)};
}

}  // namespace

std::variant<Hint, Problem> parse_hint(const ApiRequest& request) {
  return read_body<Hint>(request, [](BodyFields& body, FieldErrors&) {
    Hint hint;
    hint.place.lat_deg = body.number("lat", {.low = -90, .high = 90});
    hint.place.lon_deg = body.number("lon", {.low = -180, .high = 180});
    hint.radius_m = body.number("radius_m", {.low = 0, .high = kMaxHintRadius_m, .above_low = true});
    return hint;
  });
}

std::variant<PlaybackRequest, Problem> parse_playback(const ApiRequest& request, double length_s) {
  return read_body<PlaybackRequest>(request, [length_s](BodyFields& body, FieldErrors& errors) {
    const PlaybackRequest wanted{
        .playing = body.optional_boolean("playing"),
        .speed = body.optional_integer("speed", kPlaybackSpeeds.front(), kPlaybackSpeeds.back()),
        .at_s = body.optional_number("at_s", {.low = 0, .high = length_s})};
    if (wanted.speed &&
        std::find(kPlaybackSpeeds.begin(), kPlaybackSpeeds.end(), *wanted.speed) == kPlaybackSpeeds.end())
      errors.push_back({"/speed", fmt::format("must be one of {}", fmt::join(kPlaybackSpeeds, ", "))});
    if (errors.empty() && !wanted.playing && !wanted.speed && !wanted.at_s)
      errors.push_back({"", "must have playing, speed or at_s"});
    return wanted;
  });
}

ApiResponse answer_object_location(const ApiRequest& request, const FlightView& view, const GroundModel& ground) {
  auto parsed = read_body<ObjectRequest>(request, [](BodyFields& body, FieldErrors& errors) {
    ObjectRequest wanted;
    wanted.pixel = parse_pixel(body, errors);
    wanted.camera = parse_camera(body, wanted.zoom, errors);
    wanted.gimbal = parse_gimbal(body);
    wanted.pose = parse_pose(body);
    return wanted;
  });
  if (const auto* problem = std::get_if<Problem>(&parsed)) return answer(*problem);
  ObjectRequest& wanted = std::get<ObjectRequest>(parsed);
  if (!wanted.gimbal) {
    return answer(refused("gimbal-missing", "without the gimbal's angles a pixel has no direction; send \"gimbal\""));
  }
  if (!wanted.zoom) {
    return answer(
        refused("zoom-missing", "without the zoom a pixel has no angle; send \"camera\"/\"zoom\", 1 if fixed"));
  }
  const Eigen::Vector2d& pixel = wanted.pixel;
  if (pixel.x() > wanted.camera.width - 0.5 || pixel.y() > wanted.camera.height - 0.5) {
    return answer(refused("pixel-outside", "the pixel lies outside of the image"));
  }
  const bool own = !wanted.pose;
  if (own) {
    auto pose = own_pose(view);
    if (const auto* problem = std::get_if<Problem>(&pose)) return answer(*problem);
    wanted.pose = std::get<AircraftPose>(pose);
  }
  wanted.camera.fx *= *wanted.zoom;
  wanted.camera.fy *= *wanted.zoom;

  const bool modelled = ground.frame != nullptr && ground.surface != nullptr;
  const LocalFrame around(wanted.pose->place);
  const FlatGround flat;
  const auto located = locate_object(wanted.camera, pixel, *wanted.gimbal, *wanted.pose, {},
                                     modelled ? *ground.frame : around, modelled ? *ground.surface : flat);
  if (const auto* none = std::get_if<NoObjectPlace>(&located)) return answer(refused(none->type, none->reason));
  const ObjectPlace& object = std::get<ObjectPlace>(located);
  const nlohmann::json document{{"lon", object.place.lon_deg},
                                {"lat", object.place.lat_deg},
                                {"error_bound_m", object.error_bound_m},
                                {"range_m", object.range_m},
                                {"manoeuvring", object.manoeuvring},
                                {"pose", own ? "service" : "request"},
                                {"ground", modelled ? "package" : "flat"}};
  return {.body = document.dump()};
}

}  // namespace nadir
