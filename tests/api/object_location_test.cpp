#include "api/object_location.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "api/api_fixture.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

using test::expect_problem;

constexpr LonLat kHere{8.5, 47.4};
const CameraModel kCamera{.width = 1921, .height = 1081, .fx = 1000, .fy = 1000, .cx = 960, .cy = 540};

struct Look {
  Eigen::Vector2d pixel{960, 540};
  GimbalAngles gimbal{.yaw_rad = 0, .pitch_rad = radians(-90), .roll_rad = 0};
  AircraftPose pose{.place = kHere, .agl_m = 100, .attitude = {}, .sigma_m = 0};
  ObjectUncertainty uncertainty{};
};

struct Found {
  double east_m = 0, north_m = 0, bound_m = 0;
  bool manoeuvring = false;
};

Found find(const Look& look, const GroundSurface& surface = FlatGround(0)) {
  const LocalFrame frame(kHere);
  const auto result = locate_object(kCamera, look.pixel, look.gimbal, look.pose, look.uncertainty, frame, surface);
  const auto* place = std::get_if<ObjectPlace>(&result);
  if (place == nullptr) {
    ADD_FAILURE() << std::get<NoObjectPlace>(result).reason;
    return {};
  }
  const PlanePoint enu = frame.plane_from_lonlat(place->place);
  return {enu.east_m, enu.north_m, place->error_bound_m, place->manoeuvring};
}

TEST(ObjectLocation, AtNadirOffsetsScaleWithHeightOverFocalLength) {
  Look look;
  EXPECT_NEAR(find(look).east_m, 0, 1e-3);
  look.pixel = {1060, 340};  // right and up in the image: east and north of an aircraft that flies north
  EXPECT_NEAR(find(look).east_m, 10, 1e-3);
  EXPECT_NEAR(find(look).north_m, 20, 1e-3);
  look.pose.attitude.heading_rad = radians(90);
  EXPECT_NEAR(find(look).east_m, 20, 1e-3);
  EXPECT_NEAR(find(look).north_m, -10, 1e-3);
}

TEST(ObjectLocation, TheGimbalTurnsTheRay) {
  Look look;
  look.gimbal.pitch_rad = radians(-45);
  EXPECT_NEAR(find(look).north_m, 100, 1e-3);
  look.gimbal.yaw_rad = radians(90);
  EXPECT_NEAR(find(look).east_m, 100, 1e-3);
  EXPECT_NEAR(find(look).north_m, 0, 1e-3);
  look.pose.attitude.heading_rad = radians(180);
  EXPECT_NEAR(find(look).east_m, -100, 1e-3);
}

TEST(ObjectLocation, TheAirframeTiltsTheRayUnlessTheGimbalHoldsTheHorizon) {
  Look look;
  look.pose.attitude.pitch_rad = radians(10);  // nose up: the axis looks ahead
  EXPECT_NEAR(find(look).north_m, 100 * std::tan(radians(10)), 1e-3);
  look.pose.attitude = {0, 0, radians(10)};  // right wing down: to the left
  EXPECT_NEAR(find(look).east_m, -100 * std::tan(radians(10)), 1e-3);
  look.gimbal.from_horizon = true;
  EXPECT_NEAR(find(look).east_m, 0, 1e-3);
}

class Slope final : public GroundSurface {
 public:
  double height_m(PlanePoint point) const override { return 0.2 * point.north_m; }
  double relief_sigma_m() const override { return 0; }
};

// Looking 45° ahead at ground that rises by 0.2: 100 - d = 0.2 d.
TEST(ObjectLocation, TheRayMeetsTheTerrain) {
  Look look;
  look.gimbal.pitch_rad = radians(-45);
  EXPECT_NEAR(find(look, Slope()).north_m, 100 / 1.2, 1e-3);
}

TEST(ObjectLocation, APositionErrorIsItsOwnBound) {
  Look look;
  look.pose.sigma_m = 10;
  look.uncertainty = {.heading_rad = 0, .tilt_rad = 0, .agl_relative = 0};
  EXPECT_NEAR(find(look).bound_m, 10 * std::sqrt(5.991), 1e-6);
}

// The bound holds at least 95 % of objects whose errors are drawn at random.
TEST(ObjectLocation, TheBoundCoversTheError) {
  std::mt19937 engine(7);
  std::normal_distribution<double> normal;
  for (const double pitch_deg : {-90.0, -60.0, -35.0}) {
    Look look;
    look.pixel = {1300, 400};
    look.gimbal.pitch_rad = radians(pitch_deg);
    look.pose.sigma_m = 4;
    const Found nominal = find(look);
    const ObjectUncertainty sigma;
    int held = 0;
    constexpr int kDraws = 1500;
    for (int i = 0; i < kDraws; ++i) {
      Look truth = look;
      truth.pose.attitude = {sigma.heading_rad * normal(engine), sigma.tilt_rad * normal(engine),
                             sigma.tilt_rad * normal(engine)};
      truth.gimbal.pitch_rad += 0.5 * sigma.tilt_rad * normal(engine);
      truth.pose.agl_m *= 1 + sigma.agl_relative * normal(engine);
      const double east_m = 4 * normal(engine), north_m = 4 * normal(engine);
      const Found real = find(truth);
      if (std::hypot(real.east_m + east_m - nominal.east_m, real.north_m + north_m - nominal.north_m) <=
          nominal.bound_m)
        ++held;
    }
    EXPECT_GE(held, 0.95 * kDraws) << pitch_deg;
    EXPECT_GT(nominal.bound_m, 8);
  }
}

TEST(ObjectLocation, ManoeuvresWidenTheBound) {
  Look level, at_limit, below;
  at_limit.pose.attitude.roll_rad = radians(5);
  below.pose.attitude.roll_rad = radians(4.99);
  EXPECT_FALSE(find(below).manoeuvring);
  EXPECT_TRUE(find(at_limit).manoeuvring);
  EXPECT_GT(find(at_limit).bound_m, 1.3 * find(below).bound_m);
  EXPECT_LT(find(below).bound_m, 1.05 * find(level).bound_m);
  level.pose.attitude.pitch_rad = radians(-5);
  EXPECT_TRUE(find(level).manoeuvring);
}

TEST(ObjectLocation, RejectsPixelsInTheSky) {
  Look look;
  const LocalFrame frame(kHere);
  for (const auto& [pitch_deg, type] :
       {std::pair{0.0, "no-ground"}, {30.0, "no-ground"}, {-0.2, "no-ground"}, {-1.2, "no-bound"}}) {
    look.gimbal.pitch_rad = radians(pitch_deg);
    const auto result = locate_object(kCamera, look.pixel, look.gimbal, look.pose, {}, frame, FlatGround());
    ASSERT_TRUE(std::holds_alternative<NoObjectPlace>(result)) << pitch_deg;
    EXPECT_EQ(std::get<NoObjectPlace>(result).type, type) << pitch_deg;
  }
}

class ObjectRequests : public test::ApiFixture {
 protected:
  static nlohmann::json question() {
    return nlohmann::json::parse(R"({"pixel": {"x": 959.5, "y": 539.5},
      "camera": {"width": 1920, "height": 1080, "fx": 1000, "zoom": 1},
      "gimbal": {"pitch_deg": -90},
      "pose": {"lat": 47.4, "lon": 8.5, "agl_m": 100, "heading_deg": 0, "pitch_deg": 0, "roll_deg": 0, "sigma_m": 3}})");
  }
  ApiResponse ask(const nlohmann::json& body) { return api.handle(post("/v1/object-location", body.dump())); }
};

TEST_F(ObjectRequests, AnswersWithThePoseOfTheRequest) {
  const auto place = json(ask(question()));
  EXPECT_NEAR(place["lon"].get<double>(), 8.5, 1e-8);
  EXPECT_NEAR(place["lat"].get<double>(), 47.4, 1e-8);
  EXPECT_GT(place["error_bound_m"].get<double>(), 7);
  EXPECT_EQ(place["pose"], "request");
  EXPECT_EQ(place["ground"], "flat");
}

TEST_F(ObjectRequests, AnswersWithTheServicesOwnPose) {
  auto body = question();
  body.erase("pose");
  const auto place = json(ask(body));
  EXPECT_EQ(place["pose"], "service");
  EXPECT_NEAR(place["lat"].get<double>(), board.snapshot()->position->place.lat_deg, 2e-4);
}

TEST_F(ObjectRequests, ZoomNarrowsTheAngle) {
  auto body = question();
  body["pixel"]["x"] = 1159.5;
  const double wide = json(ask(body))["lon"].get<double>() - 8.5;
  body["camera"]["zoom"] = 4;
  EXPECT_NEAR(json(ask(body))["lon"].get<double>() - 8.5, wide / 4, 1e-9);
}

TEST_F(ObjectRequests, RejectsRequestsWithoutGimbalZoomOrPose) {
  auto body = question();
  body.erase("gimbal");
  expect_problem(ask(body), 422, "gimbal-missing");
  body = question();
  body["camera"].erase("zoom");
  expect_problem(ask(body), 422, "zoom-missing");
  body = question();
  body.erase("pose");
  publish(ServiceState::no_fix);
  expect_problem(ask(body), 422, "pose-missing");
  publish(ServiceState::normal);
  for (const auto& forget :
       {+[](FlightView& view) { view.agl_m.reset(); }, +[](FlightView& view) { view.roll_rad.reset(); }}) {
    FlightView view = flight.at(now_s, ServiceState::normal);
    forget(view);
    board.publish(view);
    expect_problem(ask(body), 422, "pose-missing");
  }
}

TEST_F(ObjectRequests, RejectsInvalidRequests) {
  auto outside = question();
  outside["pixel"]["x"] = 1920;
  expect_problem(ask(outside), 422, "pixel-outside");
  auto sky = question();
  sky["gimbal"]["pitch_deg"] = 10;
  expect_problem(ask(sky), 422, "no-ground");
  auto misspelt = question();
  misspelt["camera"]["zom"] = 2;
  expect_problem(ask(misspelt), 400, "invalid");
  auto fraction = question();
  fraction["camera"]["width"] = 1.5;
  expect_problem(ask(fraction), 400, "invalid");
  for (const char* where : {"/pixel", "/camera", "/pixel/x", "/camera/fx", "/pose/lat", "/gimbal/pitch_deg"}) {
    auto body = question();
    body[nlohmann::json::json_pointer(where)] = "x";
    expect_problem(ask(body), 400, "invalid");
    body[nlohmann::json::json_pointer(where)] = nullptr;
    expect_problem(ask(body), 400, "invalid");
  }
  expect_problem(ask(nlohmann::json::object()), 400, "invalid");
}

}  // namespace
}  // namespace nadir
