#include "flight_adjustment/tie_points.hpp"

#include <algorithm>
#include <opencv2/core.hpp>
#include <set>

#include "estimation/localizer_fixture.hpp"
#include "flight_adjustment/tie_features.hpp"
#include "geodesy/angles.hpp"

using namespace nadir;
using namespace nadir::test;

namespace {

using Pair = std::pair<std::size_t, std::size_t>;

const std::vector<Moment>& tied_moments() {
  static const std::vector<Moment> flown = flight(4);
  return flown;
}

// Where the telemetry has it: a degree and a percent off.
TieFrame rough(const Moment& moment) {
  TieFrame frame;
  frame.pose = moment.truth;
  frame.pose.position = moment.truth.position + Eigen::Vector2d(4, -3);
  frame.pose.attitude.heading_rad += radians(1);
  frame.position_sigma_m = 5;
  frame.tilt_sigma_rad = radians(1);
  frame.heading_sigma_rad = radians(1);
  frame.log_height_sigma = 0.015;
  frame.continues_flight = true;
  return frame;
}

std::vector<TieFrame> rough_frames() {
  std::vector<TieFrame> frames;
  for (const Moment& moment : tied_moments()) frames.push_back(rough(moment));
  return frames;
}

TiePoints found(const FrameImageOf& image_of) {
  NoProgress progress;
  return find_tie_points(flight_camera().camera, FlatGround(), rough_frames(), image_of, progress);
}

TieFrame at(double east_m, double north_m) {
  TieFrame frame;
  frame.pose.position = {east_m, north_m};
  frame.pose.agl_m = 100;
  return frame;
}

}  // namespace

TEST(TiePoints, ShowTheSameGroundInAllTheirFrames) {
  const TiePoints ties = found([](std::size_t i) { return tied_moments()[i].image; });
  ASSERT_GT(ties.points.size(), 60U);
  std::size_t wrong = 0, in_three = 0;
  for (const auto& point : ties.points) {
    std::vector<PlanePoint> places;
    for (const auto& o : point) {
      const auto ground = ground_from_ray(tied_moments()[o.frame].truth, ties.camera.ray_from_pixel(o.pixel));
      ASSERT_TRUE(ground);
      places.push_back(*ground);
    }
    in_three += point.size() >= 3 ? 1U : 0U;
    for (const PlanePoint& place : places) wrong += distance_m(place, places.front()) > 2 ? 1U : 0U;
  }
  EXPECT_LE(wrong, ties.points.size() / 50);
  EXPECT_GT(in_three, ties.points.size() / 4);
}

TEST(TiePoints, AreTheSameEachTime) {
  const auto image_of = [](std::size_t i) { return tied_moments()[i].image; };
  const TiePoints once = found(image_of), again = found(image_of);
  ASSERT_EQ(once.points.size(), again.points.size());
  for (std::size_t i = 0; i < once.points.size(); ++i) {
    ASSERT_EQ(once.points[i].size(), again.points[i].size());
    for (std::size_t k = 0; k < once.points[i].size(); ++k) {
      EXPECT_EQ(once.points[i][k].pixel, again.points[i][k].pixel);
    }
  }
}

TEST(TiePoints, BlackAndMissingPicturesHaveNone) {
  const TiePoints ties = found([](std::size_t i) {
    if (i == 1) return cv::Mat();
    return i == 2 ? cv::Mat(cv::Mat::zeros(tied_moments()[2].image.size(), CV_8UC1)) : tied_moments()[i].image;
  });
  for (const auto& point : ties.points) {
    for (const auto& o : point) EXPECT_TRUE(o.frame == 0 || o.frame == 3);
  }
}

TEST(TiePoints, APictureOfAnotherPlaceHasNone) {
  const TiePoints ties = found([](std::size_t i) {
    cv::Mat turned;
    if (i == 2) cv::flip(tied_moments()[2].image, turned, 0);  // no view of the same ground is a mirror image
    return i == 2 ? turned : tied_moments()[i].image;
  });
  std::size_t in_it = 0;
  for (const auto& point : ties.points) {
    in_it +=
        static_cast<std::size_t>(std::count_if(point.begin(), point.end(), [](const auto& o) { return o.frame == 2; }));
  }
  EXPECT_EQ(in_it, 0U);
}

TEST(TiePoints, CancelledItEnds) {
  NoProgress progress;
  int checks = 0;
  const Cancel cancel([&] { return ++checks > 3; });
  EXPECT_THROW(find_tie_points(
                   flight_camera().camera, FlatGround(), rough_frames(),
                   [](std::size_t i) { return tied_moments()[i].image; }, progress, cancel),
               Interrupted);
}

TEST(TiePairs, NeighboursAndTheNearestOfOtherPasses) {
  std::vector<TieFrame> frames;
  for (int i = 0; i < 10; ++i) frames.push_back(at(40.0 * i, 0));
  for (int i = 0; i < 10; ++i) frames.push_back(at(360 - 40.0 * i, 50));  // back, beside it
  const auto pairs = pairs_to_compare(flight_camera().camera, frames);
  const std::set<Pair> set(pairs.begin(), pairs.end());
  EXPECT_EQ(set.size(), pairs.size());
  for (std::size_t i = 0; i + 1 < frames.size(); ++i) EXPECT_TRUE(set.contains({i, i + 1})) << i;
  for (std::size_t i = 0; i + 2 < frames.size(); ++i) EXPECT_TRUE(set.contains({i, i + 2})) << i;
  EXPECT_TRUE(set.contains({2, 17}));
  EXPECT_TRUE(set.contains({5, 14}));
  EXPECT_FALSE(set.contains({0, 12}));
  EXPECT_LT(pairs.size(), 4 * frames.size());
}

TEST(TiePairs, AHoverIsBounded) {
  const std::vector<TieFrame> frames(500, at(0, 0));
  EXPECT_LE(pairs_to_compare(flight_camera().camera, frames).size(), 6 * frames.size());
  EXPECT_TRUE(pairs_to_compare(flight_camera().camera, {}).empty());
  EXPECT_TRUE(pairs_to_compare(flight_camera().camera, std::vector<TieFrame>(1)).empty());
}

TEST(TieFeatures, AreSpreadOverThePictureAndBounded) {
  const CameraModel camera = tie_camera(flight_camera().camera);
  const TieFeatures features = tie_features(tied_moments()[0].image, camera);
  EXPECT_GT(features.size(), 100U);
  EXPECT_LE(features.size(), 600U);
  EXPECT_EQ(features.descriptors.size(), features.size() * TieFeatures::kLength);
  EXPECT_EQ(tie_features({}, camera).size(), 0U);
  EXPECT_EQ(tie_features(cv::Mat::zeros(camera.height, camera.width, CV_8UC1), camera).size(), 0U);
}
