#include "vision/patch_matching.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "geodesy/angles.hpp"
#include "vision/camera_pose_solver.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

using test::Landscape;
using test::photograph;
using test::small_camera;

const Landscape& patch_landscape() {
  static const Landscape world(6, 150);
  return world;
}

GroundGrid aligned(const MapWindow& map, const CameraModel& camera, const CameraPose& pose) {
  const auto box = footprint_of(camera, pose);
  EXPECT_TRUE(box);
  GroundGrid grid;
  grid.gsd_m = map.gsd_m;
  grid.west_m = map.west_m + std::floor((box->west_m - map.west_m) / map.gsd_m) * map.gsd_m;
  grid.north_m = map.north_m - std::floor((map.north_m - box->north_m) / map.gsd_m) * map.gsd_m;
  grid.columns = static_cast<int>((box->east_m - grid.west_m) / map.gsd_m);
  grid.rows = static_cast<int>((grid.north_m - box->south_m) / map.gsd_m);
  return grid;
}

PatchMatches matches_at(const cv::Mat& picture, const CameraPose& claimed, const MapWindow& map) {
  const RectifiedFrame frame = rectify({picture, small_camera()}, claimed, aligned(map, small_camera(), claimed));
  return match_patches(frame, small_camera(), claimed, map, {});
}

void expect_sound(const PatchMatches& matches) {
  for (const PatchMatch& match : matches.found) {
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> eigen(match.information_m2);
    EXPECT_GT(eigen.eigenvalues()[0], 0) << "an information matrix below zero repels the solution";
    EXPECT_LT(eigen.eigenvalues()[1], 1 / (0.29 * 0.29 * 0.25)) << "no patch is better than its floor";
    EXPECT_GE(match.score, 0.2);
    EXPECT_LE(match.score, 1.001);
  }
}

TEST(PatchMatching, MeasuresThePoseError) {
  const CameraPose truth{{10, -15}, 100, {radians(40), radians(5), radians(-4)}};
  const MapWindow map = patch_landscape().map(0.5, true);
  const cv::Mat picture = photograph(patch_landscape().ground(), small_camera(), truth);
  CameraPose claimed = truth;
  claimed.position = {12.2, -16.3};
  const PatchMatches matches = matches_at(picture, claimed, map);
  EXPECT_GT(matches.tried, 40);
  ASSERT_GT(matches.found.size(), 0.7 * matches.tried);
  expect_sound(matches);
  int right = 0;
  for (const PatchMatch& match : matches.found) {
    const double east = match.on_map.east_m - match.in_frame.east_m,
                 north = match.on_map.north_m - match.in_frame.north_m;
    right += std::hypot(east + 2.2, north - 1.3) < 0.25 ? 1 : 0;
  }
  EXPECT_GT(right, 0.85 * static_cast<double>(matches.found.size())) << "half a pixel";
}

TEST(PatchMatching, FindsTheCameraWithTheSolver) {
  const CameraPose truth{{10, -15}, 100, {radians(40), radians(5), radians(-4)}};
  const MapWindow map = patch_landscape().map(0.5, true);
  const cv::Mat picture = photograph(patch_landscape().ground(), small_camera(), truth);
  CameraPose pose = truth;
  pose.position = {11.5, -16};
  pose.agl_m *= 1.01;
  pose.attitude.heading_rad += radians(1);
  std::optional<SolvedPose> solved;
  for (int round = 0; round < 2; ++round) {
    std::vector<GroundCorrespondence> correspondences;
    for (const PatchMatch& match : matches_at(picture, pose, map).found) {
      const Eigen::Vector3d point = camera_from_ground(pose, match.in_frame);
      correspondences.push_back({point / point.z(), match.on_map, match.information_m2});
    }
    PosePrior prior;
    prior.pose = pose;
    prior.pose.attitude.pitch_rad = truth.attitude.pitch_rad;
    prior.pose.attitude.roll_rad = truth.attitude.roll_rad;
    prior.tilt_covariance_rad2 = Eigen::Matrix2d::Identity() * 1e-8;
    solved = solve_camera_pose(correspondences, prior, {2.0, 0.1});
    ASSERT_TRUE(solved);
    pose = solved->pose;
  }
  EXPECT_NEAR(pose.position.east_m, 10, 0.15);
  EXPECT_NEAR(pose.position.north_m, -15, 0.15);
  EXPECT_NEAR(pose.agl_m, 100, 0.2);
  EXPECT_NEAR(pose.attitude.heading_rad, truth.attitude.heading_rad, radians(0.1));
}

TEST(PatchMatching, BareGroundGivesNoMatch) {
  const CameraPose pose{{0, 0}, 100, {}};
  MapWindow map = patch_landscape().map(0.5);
  const cv::Mat picture = photograph(patch_landscape().ground(), small_camera(), pose);
  map.image.setTo(128);
  EXPECT_TRUE(matches_at(picture, pose, map).found.empty());
}

// One straight border through the frame, at any angle: sharp across, vague along, never negative.
TEST(PatchMatching, AnEdgeIsPreciseAcrossAndUncertainAlong) {
  int found = 0;
  for (const double degree : {0.0, 30.0, 45.0, 90.0, 135.0}) {
    const double direction = radians(degree);  // of the border, from east to north
    const Eigen::Vector2d along(std::cos(direction), std::sin(direction));
    const Eigen::Vector2d across(-along.y(), along.x());
    const auto ground = [&](PlanePoint p) {
      return 120 + 60 * std::tanh(p.east_m * across.x() + p.north_m * across.y());
    };
    MapWindow map = patch_landscape().map(0.5);
    for (int r = 0; r < map.image.rows; ++r) {
      for (int c = 0; c < map.image.cols; ++c) {
        map.image.at<std::uint8_t>(r, c) =
            cv::saturate_cast<std::uint8_t>(ground(map.plane_from_pixel(c + 0.5, r + 0.5)));
      }
    }
    const CameraPose pose{{0, 0}, 100, {}};
    const PatchMatches matches = matches_at(photograph(ground, small_camera(), pose), pose, map);
    for (const PatchMatch& match : matches.found) {
      const double off_m = match.in_frame.east_m * across.x() + match.in_frame.north_m * across.y();
      if (std::abs(off_m) > 10) continue;  // beside the border there is nothing
      ++found;
      const double sharp = across.dot(match.information_m2 * across), vague = along.dot(match.information_m2 * along);
      EXPECT_GT(sharp, 2 * vague) << degree;
    }
  }
  EXPECT_GT(found, 0);
}

TEST(PatchMatching, InformationIsNeverNegative) {
  const MapWindow map = patch_landscape().map(0.5);
  const CameraPose truth{{0, 0}, 100, {}};
  const cv::Mat picture = photograph(patch_landscape().ground(), small_camera(), truth);
  for (const double wrong_m : {15.0, 22.0, 29.0, 36.0}) {  // the content lies elsewhere: whatever is found is noise
    CameraPose claimed = truth;
    claimed.position = {wrong_m, -wrong_m / 2};
    expect_sound(matches_at(picture, claimed, map));
  }
}

TEST(PatchMatching, NothingIsFoundOffTheMap) {
  const CameraPose truth{{0, 0}, 100, {}};
  const MapWindow map = patch_landscape().map(0.5);
  CameraPose away = truth;
  away.position = {5000, 5000};
  const PatchMatches matches = matches_at(photograph(test::waves, small_camera(), truth), away, map);
  EXPECT_TRUE(matches.found.empty());
}

}  // namespace
}  // namespace nadir
