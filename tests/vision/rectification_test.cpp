#include "vision/rectification.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "geodesy/angles.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

using test::bent_camera;
using test::coordinates;
using test::photograph;
using test::seen_by_pixel;
using test::small_camera;
using test::waves;

GroundGrid grid_over(const CameraModel& camera, const CameraPose& pose, double gsd_m) {
  const auto box = footprint_of(camera, pose);
  EXPECT_TRUE(box);
  GroundGrid grid{box->west_m, box->north_m, gsd_m, 0, 0};
  grid.columns = static_cast<int>((box->east_m - box->west_m) / gsd_m);
  grid.rows = static_cast<int>((box->north_m - box->south_m) / gsd_m);
  return grid;
}

struct RectifiedCase {
  const char* name;
  CameraModel camera;
  CameraPose pose;
  double gsd_m;
};

std::vector<RectifiedCase> cases() {
  return {{"level", small_camera(), {{30, -20}, 100, {}}, 0.5},
          {"turned and tilted", small_camera(), {{-5, 8}, 100, {radians(133), radians(8), radians(-11)}}, 0.5},
          {"bent lens", bent_camera(), {{0, 0}, 100, {radians(45), radians(5), radians(5)}}, 0.5},
          {"banked", bent_camera(), {{0, 0}, 80, {radians(-60), radians(2), radians(12)}}, 0.6}};
}

TEST(Rectification, RecoversTheGround) {
  for (const RectifiedCase& test : cases()) {
    const cv::Mat picture = photograph(waves, test.camera, test.pose);
    const RectifiedFrame frame =
        rectify({picture, test.camera}, test.pose, grid_over(test.camera, test.pose, test.gsd_m));
    double squares = 0, worst = 0;
    int count = 0;
    for (int r = 0; r < frame.grid.rows; ++r) {
      for (int c = 0; c < frame.grid.columns; ++c) {
        if (frame.mask.at<std::uint8_t>(r, c) == 0) continue;
        const double off = frame.image.at<std::uint8_t>(r, c) - waves(frame.grid.plane_from_pixel(c + 0.5, r + 0.5));
        squares += off * off;
        worst = std::max(worst, std::abs(off));
        ++count;
      }
    }
    ASSERT_GT(count, 10000) << test.name;
    EXPECT_LT(std::sqrt(squares / count), 0.8) << test.name << ": half a pixel off would be about 8 grey levels";
    EXPECT_LT(worst, 6) << test.name;
  }
}

TEST(Rectification, InterpolationErrsByLessThanATenthOfAPixel) {
  for (const RectifiedCase& test : cases()) {
    const GroundGrid grid = grid_over(test.camera, test.pose, test.gsd_m);
    const RectifiedFrame frame = rectify({coordinates(test.camera), test.camera}, test.pose, grid);
    double worst = 0;
    for (int r = 0; r < grid.rows; ++r) {
      for (int c = 0; c < grid.columns; ++c) {
        if (frame.mask.at<std::uint8_t>(r, c) == 0) continue;
        const auto from = frame.image.at<cv::Vec2f>(r, c);
        const Eigen::Vector2d exact =
            test.camera.pixel_from_point(camera_from_ground(test.pose, grid.plane_from_pixel(c + 0.5, r + 0.5)));
        worst = std::max(
            worst, std::hypot(static_cast<double>(from[0]) - exact.x(), static_cast<double>(from[1]) - exact.y()));
      }
    }
    EXPECT_LT(worst, 0.1) << test.name;
  }
}

// A cell is valid exactly when its place lies inside the ring that the image's rim draws on the ground.
TEST(Rectification, MaskIsWhatTheFrameShows) {
  for (const RectifiedCase& test : cases()) {
    PlaneRing rim;
    const double right = test.camera.width - 1.0, bottom = test.camera.height - 1.0;
    for (double x = 0; x < right; x += 1) rim.push_back(seen_by_pixel(test.camera, test.pose, x, 0));
    for (double y = 0; y < bottom; y += 1) rim.push_back(seen_by_pixel(test.camera, test.pose, right, y));
    for (double x = right; x > 0; x -= 1) rim.push_back(seen_by_pixel(test.camera, test.pose, x, bottom));
    for (double y = bottom; y > 0; y -= 1) rim.push_back(seen_by_pixel(test.camera, test.pose, 0, y));
    GroundGrid grid = grid_over(test.camera, test.pose, test.gsd_m);
    grid.west_m -= 40 * grid.gsd_m;  // well beyond the image on all sides
    grid.north_m += 40 * grid.gsd_m;
    grid.columns += 80;
    grid.rows += 80;
    const cv::Mat picture(test.camera.height, test.camera.width, CV_8UC1, cv::Scalar(100));
    const RectifiedFrame frame = rectify({picture, test.camera}, test.pose, grid);
    int wrong = 0;
    for (int r = 0; r < grid.rows; ++r) {
      for (int c = 0; c < grid.columns; ++c) {
        const PlanePoint cell = grid.plane_from_pixel(c + 0.5, r + 0.5);
        const bool expected = contains(rim, cell);
        if ((frame.mask.at<std::uint8_t>(r, c) != 0) != expected) {
          const PlanePath border(rim.begin(), rim.end());
          wrong += distance_to_path_m(border, cell) > grid.gsd_m ? 1 : 0;
        }
      }
    }
    EXPECT_EQ(wrong, 0) << test.name;
  }
}

// Far outside of the image a barrel lens' polynomial turns back and would show the image's rim a second time.
TEST(Rectification, AFoldingLensShowsNothingTwice) {
  CameraModel camera = small_camera();
  camera.fx = camera.fy = 300;
  camera.distortion = {-0.3, 0, 0, 0, 0};
  const CameraPose pose{{0, 0}, 100, {radians(45), 0, 0}};
  const GroundGrid grid{-260, 260, 1.0, 520, 520};  // up to 260 m from under the camera; the image ends at 95 m
  const RectifiedFrame frame = rectify({coordinates(camera), camera}, pose, grid);
  int far = 0;
  for (int r = 0; r < grid.rows; ++r) {
    for (int c = 0; c < grid.columns; ++c) {
      const PlanePoint cell = grid.plane_from_pixel(c + 0.5, r + 0.5);
      if (std::hypot(cell.east_m, cell.north_m) > 140 && frame.mask.at<std::uint8_t>(r, c) != 0) ++far;
    }
  }
  EXPECT_EQ(far, 0);
}

// Rays beyond 72 degrees off nadir hit no ground; the cells next to them must not sweep through the image.
TEST(Rectification, NothingAppearsTowardsTheHorizon) {
  const CameraModel camera = small_camera();
  const CameraPose pose{{0, 0}, 50, {0, radians(20), 0}};
  const GroundGrid grid{-400, 800, 2.0, 400, 400};  // reaches 800 m ahead; the image ends at some 90 m
  const RectifiedFrame frame = rectify({coordinates(camera), camera}, pose, grid);
  int far = 0;
  for (int r = 0; r < grid.rows; ++r) {
    for (int c = 0; c < grid.columns; ++c) {
      const PlanePoint cell = grid.plane_from_pixel(c + 0.5, r + 0.5);
      if (std::hypot(cell.east_m, cell.north_m) > 130 && frame.mask.at<std::uint8_t>(r, c) != 0) ++far;
    }
  }
  EXPECT_EQ(far, 0);
}

TEST(Rectification, FootprintContainsTheImageBorder) {
  for (const RectifiedCase& test : cases()) {
    const auto box = footprint_of(test.camera, test.pose);
    ASSERT_TRUE(box) << test.name;
    PlaneBox rim{1e9, 1e9, -1e9, -1e9};
    for (double t = 0; t <= 1; t += 0.005) {
      const double x = t * (test.camera.width - 1), y = t * (test.camera.height - 1);
      for (const PlanePoint p : {seen_by_pixel(test.camera, test.pose, x, 0),
                                 seen_by_pixel(test.camera, test.pose, x, test.camera.height - 1),
                                 seen_by_pixel(test.camera, test.pose, 0, y),
                                 seen_by_pixel(test.camera, test.pose, test.camera.width - 1, y)}) {
        rim = {std::min(rim.west_m, p.east_m), std::min(rim.south_m, p.north_m), std::max(rim.east_m, p.east_m),
               std::max(rim.north_m, p.north_m)};
      }
    }
    const double slack_m = 0.03 * (rim.east_m - rim.west_m);  // the box comes from eight points of a bent rim
    EXPECT_NEAR(box->west_m, rim.west_m, slack_m) << test.name;
    EXPECT_NEAR(box->east_m, rim.east_m, slack_m) << test.name;
    EXPECT_NEAR(box->south_m, rim.south_m, slack_m) << test.name;
    EXPECT_NEAR(box->north_m, rim.north_m, slack_m) << test.name;
  }
}

TEST(Rectification, NoFootprintAtTheHorizon) {
  EXPECT_FALSE(footprint_of(small_camera(), {{0, 0}, 100, {0, radians(50), 0}}));
  EXPECT_FALSE(ground_from_ray({{0, 0}, 100, {}}, {0, 0, -1}));
  EXPECT_FALSE(ground_from_ray({{0, 0}, 100, {}}, {1, 0, 0}));
}

TEST(Rectification, RayAndGroundAreInverse) {
  const CameraPose pose{{12, -7}, 130, {radians(200), radians(-8), radians(15)}};
  const PlanePoint place{40, 22};
  const auto back = ground_from_ray(pose, camera_from_ground(pose, place));
  ASSERT_TRUE(back);
  EXPECT_NEAR(back->east_m, place.east_m, 1e-9);
  EXPECT_NEAR(back->north_m, place.north_m, 1e-9);
}

TEST(Rectification, ReducesOnlyWhatIsMuchFiner) {
  CameraModel camera = small_camera();
  const cv::Mat picture = photograph(waves, camera, {{0, 0}, 100, {}});
  EXPECT_DOUBLE_EQ(gsd_at(camera, 95), 0.5);
  EXPECT_EQ(reduce_frame(picture, camera, 95, 0.5).image.size(), picture.size());
  const ReducedFrame reduced = reduce_frame(picture, camera, 95, 2.0);
  EXPECT_EQ(reduced.image.cols, 96);  // 1.2 · 0.5 / 2.0 of 320
  EXPECT_EQ(reduced.camera.width, reduced.image.cols);
  EXPECT_EQ(reduced.camera.height, reduced.image.rows);
}

}  // namespace
}  // namespace nadir
