#include "adjustment/object_place.hpp"

#include <Eigen/Dense>
#include <cmath>

#include "base/error.hpp"
#include "base/random.hpp"
#include "drawn_block.hpp"
#include "geodesy/angles.hpp"

using namespace nadir;
using namespace nadir::test;

namespace {

CameraModel object_camera() {
  CameraModel camera;
  camera.width = 1200, camera.height = 900;
  camera.fx = camera.fy = 1000;
  camera.cx = 599.5, camera.cy = 449.5;
  camera.distortion = {-0.08, 0.03, 0.0005, -0.0003, 0};
  return camera;
}

PoseCovariance pose_noise(double position_m, double turn_rad) {
  PoseCovariance covariance = PoseCovariance::Zero();
  covariance.diagonal().head<3>().setConstant(position_m * position_m);
  covariance.diagonal().tail<3>().setConstant(turn_rad * turn_rad);
  return covariance;
}

SightedFrame sighted(PlanePoint at, double agl_m, Attitude attitude, const PoseCovariance& covariance) {
  return {{at, agl_m, attitude}, covariance};
}

Eigen::Vector2d seen_at(const CameraModel& camera, const SightedFrame& frame, const Eigen::Vector3d& object,
                        const GroundSurface& ground) {
  const CameraPose& pose = frame.pose;
  const Eigen::Vector3d centre(pose.position.east_m, pose.position.north_m,
                               pose.agl_m + ground.height_m(pose.position));
  return camera.pixel_from_point(enu_from_camera(pose.attitude).transpose() * (object - centre));
}

// The frame as someone knows it who errs by its covariance.
SightedFrame erring(const SightedFrame& truth, const GroundSurface& ground, const Eigen::Matrix<double, 6, 1>& error) {
  SightedFrame frame = truth;
  const double up = truth.pose.agl_m + ground.height_m(truth.pose.position) + error[2];
  frame.pose.position = truth.pose.position + Eigen::Vector2d(error.head<2>());
  frame.pose.agl_m = up - ground.height_m(frame.pose.position);
  frame.pose.attitude =
      attitude_from_matrix(enu_from_camera(truth.pose.attitude) * rotation_from_vector(error.tail<3>()));
  return frame;
}

Eigen::Matrix<double, 6, 1> drawn_error(Random& random, const PoseCovariance& covariance) {
  Eigen::Matrix<double, 6, 1> error;
  for (Eigen::Index i = 0; i < 6; ++i) error[i] = random.normal(0, std::sqrt(covariance(i, i)));
  return error;
}

LocatedObject located(const std::variant<LocatedObject, LocationProblem>& result) {
  const auto* object = std::get_if<LocatedObject>(&result);
  if (object == nullptr) ADD_FAILURE() << name_of(std::get<LocationProblem>(result));
  return object == nullptr ? LocatedObject{} : *object;
}

LocationProblem problem(const std::variant<LocatedObject, LocationProblem>& result) {
  return std::get<LocationProblem>(result);
}

class Step final : public GroundSurface {  // a wall of 40 m at 60 m north
 public:
  double height_m(PlanePoint point) const override { return point.north_m > 60 && point.north_m < 70 ? 40 : 0; }
  double relief_sigma_m() const override { return 1; }
};

}  // namespace

TEST(ObjectPlace, UnderTheCameraInClosedForm) {
  const FlatGround ground;
  const std::vector<SightedFrame> frames{sighted({10, 20}, 100, {}, pose_noise(3, 0.01))};
  const std::vector<ObjectSighting> sightings{{0, {599.5, 449.5}, 2}};
  const LocatedObject object = located(place_object(object_camera(), ground, frames, sightings, 4));
  EXPECT_LT(distance_m(object.place, {10, 20}), 1e-4);
  EXPECT_NEAR(object.height_m, 0, 1e-4);
  // 3 m of the position, 1 m of the tilt, 0.2 m of the pixel; straight down the ground's height does not matter.
  EXPECT_NEAR(object.covariance_m2(0, 0), 9 + 1 + 0.04, 0.01);
  EXPECT_NEAR(object.covariance_m2(2, 2), 16, 0.01);
  EXPECT_NEAR(object.ellipse_95.major_m, std::sqrt(5.991 * 10.04), 0.01);
  EXPECT_EQ(object.degrees_of_freedom, 0);
  EXPECT_TRUE(object.agrees);
}

TEST(ObjectPlace, ASightingFromTheSideErrsAlongItsRay) {
  const FlatGround ground;
  // 45° ahead, to the east.
  const std::vector<SightedFrame> frames{sighted({0, 0}, 100, {kPi / 2, kPi / 4, 0}, pose_noise(0.1, 1e-4))};
  const LocatedObject object =
      located(place_object(object_camera(), ground, frames, std::vector<ObjectSighting>{{0, {599.5, 449.5}, 0.1}}, 5));
  EXPECT_LT(distance_m(object.place, {100, 0}), 1e-3);
  EXPECT_NEAR(object.ellipse_95.major_m, std::sqrt(5.991) * 5, 0.05);  // 1 m of height is 1 m along
  EXPECT_LT(object.ellipse_95.minor_m, 0.5);
  EXPECT_NEAR(object.ellipse_95.bearing_deg, 90, 0.06);
}

TEST(ObjectPlace, TheRayStopsAtTheFirstGround) {
  const Step ground;
  // Looks north, over the wall's foot: 80 m at the level of the ground would be behind the wall.
  const std::vector<SightedFrame> frames{sighted({0, 0}, 100, {0, std::atan2(80.0, 100.0), 0}, pose_noise(1, 0.01))};
  const LocatedObject object =
      located(place_object(object_camera(), ground, frames, std::vector<ObjectSighting>{{0, {599.5, 449.5}}}, 1));
  EXPECT_GT(object.place.north_m, 59);
  EXPECT_LT(object.place.north_m, 71);
}

TEST(ObjectPlace, OneSightingIsAsFarOffAsItSays) {
  const RollingGround ground;
  const CameraModel camera = object_camera();
  Random random(21);
  double nees = 0;
  constexpr int kDraws = 400;
  const PoseCovariance covariance = pose_noise(2, 0.01);
  for (int i = 0; i < kDraws; ++i) {
    const SightedFrame truth =
        sighted({random.uniform(-200, 200), random.uniform(-200, 200)}, 150,
                {random.uniform(-3, 3), random.uniform(-0.3, 0.3), random.uniform(-0.3, 0.3)}, covariance);
    Eigen::Vector3d object(truth.pose.position.east_m + random.uniform(-40, 40),
                           truth.pose.position.north_m + random.uniform(-40, 40), 0);
    object.z() = ground.height_m({object.x(), object.y()}) + random.normal(0, 2);
    const Eigen::Vector2d pixel =
        seen_at(camera, truth, object, ground) + 2 * Eigen::Vector2d(random.normal(), random.normal());
    const std::vector<SightedFrame> frames{erring(truth, ground, drawn_error(random, covariance))};
    const LocatedObject found =
        located(place_object(camera, ground, frames, std::vector<ObjectSighting>{{0, pixel, 2}}, 2));
    const Eigen::Vector3d error = Eigen::Vector3d(found.place.east_m, found.place.north_m, found.height_m) - object;
    nees += error.dot(found.covariance_m2.llt().solve(error)) / kDraws;
  }
  EXPECT_NEAR(nees, 3, 0.5);
}

TEST(ObjectPlace, SeveralFramesTogetherWithTheirJointCovariance) {
  const RollingGround ground;
  const CameraModel camera = object_camera();
  Random random(22);
  const PoseCovariance own = pose_noise(0.3, 0.001), common = pose_noise(3, 0.004);
  constexpr std::size_t kFrames = 4;
  constexpr int kDraws = 300;
  Eigen::MatrixXd joint = Eigen::MatrixXd::Zero(6 * kFrames, 6 * kFrames);
  for (Eigen::Index a = 0; a < static_cast<Eigen::Index>(kFrames); ++a) {
    for (Eigen::Index b = 0; b < static_cast<Eigen::Index>(kFrames); ++b) joint.block<6, 6>(6 * a, 6 * b) = common;
    joint.block<6, 6>(6 * a, 6 * a) += own;
  }
  double nees = 0, cautious = 0;
  int agreed = 0;
  for (int i = 0; i < kDraws; ++i) {
    const Eigen::Vector3d object(random.uniform(-20, 20), random.uniform(-20, 20), 0);
    const Eigen::Vector3d at(object.x(), object.y(), ground.height_m({object.x(), object.y()}) + random.normal(0, 3));
    std::vector<SightedFrame> frames;
    std::vector<ObjectSighting> sightings;
    const auto shared = drawn_error(random, common);
    for (std::size_t k = 0; k < kFrames; ++k) {
      const SightedFrame truth =
          sighted({-45.0 + 30 * static_cast<double>(k), 10}, 150, {0.1, 0, 0}, PoseCovariance(own + common));
      sightings.push_back(
          {k, seen_at(camera, truth, at, ground) + 2 * Eigen::Vector2d(random.normal(), random.normal()), 2});
      frames.push_back(erring(truth, ground, shared + drawn_error(random, own)));
    }
    const LocatedObject found = located(place_object(camera, ground, frames, sightings, 3, joint));
    const Eigen::Vector3d error = Eigen::Vector3d(found.place.east_m, found.place.north_m, found.height_m) - at;
    nees += error.dot(found.covariance_m2.llt().solve(error)) / kDraws;
    agreed += found.agrees ? 1 : 0;
    const LocatedObject without = located(place_object(camera, ground, frames, sightings, 3));
    const Eigen::Vector3d error_without =
        Eigen::Vector3d(without.place.east_m, without.place.north_m, without.height_m) - at;
    cautious += error_without.dot(without.covariance_m2.llt().solve(error_without)) / kDraws;
    EXPECT_TRUE(without.agrees);
  }
  EXPECT_NEAR(nees, 3, 0.6);
  EXPECT_GE(agreed, kDraws - 4);  // 99.9 %
  EXPECT_LT(cautious, 3.3);       // without the joint covariance never too sure
}

TEST(ObjectPlace, AMastIsFoundAboveTheGround) {
  const FlatGround ground;
  const CameraModel camera = object_camera();
  const Eigen::Vector3d top(5, 8, 30);
  std::vector<SightedFrame> frames;
  std::vector<ObjectSighting> sightings;
  for (std::size_t k = 0; k < 4; ++k) {
    frames.push_back(sighted({-60.0 + 40 * static_cast<double>(k), 0}, 120, {}, pose_noise(0.1, 0.0002)));
    sightings.push_back({k, seen_at(camera, frames[k], top, ground), 0.5});
  }
  const LocatedObject object = located(place_object(camera, ground, frames, sightings, 50));
  EXPECT_LT(distance_m(object.place, {5, 8}), 0.1);
  EXPECT_NEAR(object.height_m, 30, 0.2);
  EXPECT_TRUE(object.agrees);
}

TEST(ObjectPlace, AClickOnSomethingElseIsNamed) {
  const FlatGround ground;
  const CameraModel camera = object_camera();
  std::vector<SightedFrame> frames;
  std::vector<ObjectSighting> sightings;
  for (std::size_t k = 0; k < 5; ++k) {
    frames.push_back(sighted({-60.0 + 30 * static_cast<double>(k), 5}, 120, {}, pose_noise(0.3, 0.001)));
    sightings.push_back({k, seen_at(camera, frames[k], {0, 0, 0}, ground), 2});
  }
  const LocatedObject right = located(place_object(camera, ground, frames, sightings, 3));
  EXPECT_TRUE(right.agrees);
  EXPECT_FALSE(right.worst);
  sightings[3].pixel += Eigen::Vector2d(20, 90);
  const LocatedObject wrong = located(place_object(camera, ground, frames, sightings, 3));
  EXPECT_FALSE(wrong.agrees);
  ASSERT_TRUE(wrong.worst);
  EXPECT_EQ(*wrong.worst, 3U);
  EXPECT_GT(wrong.covariance_m2(0, 0), right.covariance_m2(0, 0));
}

TEST(ObjectPlace, TwoClicksInOneFrameShareItsError) {
  const FlatGround ground;
  const std::vector<SightedFrame> frames{sighted({0, 0}, 100, {}, pose_noise(3, 1e-5))};
  const std::vector<ObjectSighting> sightings{{0, {599.5, 449.5}, 2}, {0, {601.5, 449.5}, 2}};
  const LocatedObject object = located(place_object(object_camera(), ground, frames, sightings, 1));
  EXPECT_NEAR(object.place.east_m, 0.1, 0.01);
  EXPECT_NEAR(object.covariance_m2(0, 0), 9 + 0.02, 0.02);  // the pixels average, the position does not
}

// A camera that looks above the horizon sees the slope of a mountain.
TEST(ObjectPlace, ARayThatRisesMeetsAMountain) {
  class Mountain final : public GroundSurface {  // from 500 m north on it rises by half
   public:
    double height_m(PlanePoint point) const override { return 0.5 * std::max(0.0, point.north_m - 500); }
    double relief_sigma_m() const override { return 1; }
  };
  const double up = radians(2);
  const std::vector<SightedFrame> frames{sighted({0, 0}, 100, {0, kPi / 2 + up, 0}, pose_noise(1, 1e-3))};
  const std::vector<ObjectSighting> centre{{0, {599.5, 449.5}}};
  const LocatedObject object = located(place_object(object_camera(), Mountain(), frames, centre, 1));
  EXPECT_NEAR(object.place.north_m, 350 / (0.5 - std::tan(up)), 0.5);
  EXPECT_NEAR(object.place.east_m, 0, 0.5);
}

TEST(ObjectPlace, SaysWhyThereIsNoPlace) {
  const FlatGround ground;
  const CameraModel camera = object_camera();
  const std::vector<ObjectSighting> centre{{0, {599.5, 449.5}}};
  const std::vector<SightedFrame> up{sighted({0, 0}, 100, {0, 1.7, 0}, pose_noise(1, 0.01))};
  EXPECT_EQ(problem(place_object(camera, ground, up, centre, 1)), LocationProblem::above_horizon);
  const std::vector<SightedFrame> far{sighted({0, 0}, 100, {0, kPi / 2 - 0.001, 0}, pose_noise(1, 0.01))};
  EXPECT_EQ(problem(place_object(camera, ground, far, centre, 1)), LocationProblem::no_ground);
  const std::vector<SightedFrame> buried{sighted({0, 0}, -5, {}, pose_noise(1, 0.01))};
  EXPECT_EQ(problem(place_object(camera, ground, buried, centre, 1)), LocationProblem::no_ground);
  EXPECT_EQ(name_of(LocationProblem::diverging), "diverging");
}

TEST(ObjectPlace, ImpossibleInputIsRefused) {
  const FlatGround ground;
  const CameraModel camera = object_camera();
  const std::vector<SightedFrame> frames{sighted({0, 0}, 100, {}, pose_noise(1, 0.01))};
  const std::vector<ObjectSighting> good{{0, {599.5, 449.5}}};
  const double nan = std::nan("");
  EXPECT_THROW(place_object(camera, ground, frames, {}, 1), UsageError);
  EXPECT_THROW(place_object(camera, ground, frames, std::vector<ObjectSighting>(65, good[0]), 1), UsageError);
  EXPECT_THROW(place_object(camera, ground, frames, std::vector<ObjectSighting>{{1, {5, 5}}}, 1), UsageError);
  EXPECT_THROW(place_object(camera, ground, frames, std::vector<ObjectSighting>{{0, {nan, 5}}}, 1), UsageError);
  EXPECT_THROW(place_object(camera, ground, frames, std::vector<ObjectSighting>{{0, {5, 5}, 0}}, 1), UsageError);
  EXPECT_THROW(place_object(camera, ground, frames, good, nan), UsageError);
  EXPECT_THROW(place_object(camera, ground, frames, good, 1, Eigen::MatrixXd::Identity(5, 5)), UsageError);
  std::vector<SightedFrame> bad = frames;
  bad[0].pose.agl_m = nan;
  EXPECT_THROW(place_object(camera, ground, bad, good, 1), UsageError);
}

TEST(ObjectPlace, ThePoseCovarianceOfTheFilterInTurnsOfTheCamera) {
  // Level and to the north: heading turns about the camera's z, which looks down.
  CameraPose pose;
  pose.agl_m = 200;
  Eigen::Matrix<double, 6, 6> filter = Eigen::Matrix<double, 6, 6>::Zero();
  filter.diagonal() << 4, 9, 0.01 * 0.01, 0.05 * 0.05, 0.02 * 0.02, 0.01 * 0.01;
  const PoseCovariance covariance = pose_covariance(pose, filter);
  EXPECT_NEAR(covariance(0, 0), 4, 1e-9);
  EXPECT_NEAR(covariance(2, 2), 4, 1e-9);
  EXPECT_NEAR(covariance(5, 5), 0.05 * 0.05, 1e-9);  // heading
  EXPECT_NEAR(covariance(3, 3), 0.02 * 0.02, 1e-9);  // pitch turns about the image's x
  EXPECT_NEAR(covariance(4, 4), 0.01 * 0.01, 1e-9);  // roll about its y
}
