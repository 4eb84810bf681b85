#include "vision/map_search.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "geodesy/angles.hpp"
#include "support/cancel_after.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

using test::Landscape;
using test::photograph;
using test::small_camera;

constexpr double kGsd_m = 1.0;

const Landscape& landscape() {
  static const Landscape world(5, 230);
  return world;
}

struct Scene {
  CameraPose truth{{34, -52}, 100, {radians(75), radians(4), radians(-6)}};
  MapWindow map = landscape().map(kGsd_m, true);  // another light than the photograph's
  SearchPrior prior;
  cv::Mat picture;

  Scene() {
    picture = photograph(landscape().ground(), small_camera(), truth);
    prior.pose = truth;
    prior.pose.position = {20, -40};
    prior.radius_m = 100;
  }
  SearchResult search(const Cancel& cancel = {}) const {
    SearchOptions options;
    options.gsd_m = kGsd_m;
    options.cancel = cancel;
    return search_window(picture, small_camera(), map, prior, options);
  }
};

double off_m(const MatchHypothesis& place, const CameraPose& truth) {
  return distance_m(place.pose.position, truth.position);
}

TEST(MapSearch, FindsThePositionToAPixel) {
  const Scene scene;
  const SearchResult result = scene.search();
  ASSERT_GE(result.places.size(), 2U);
  EXPECT_LT(off_m(result.places[0], scene.truth), kGsd_m);
  EXPECT_LT(result.ratio, 0.7);
  EXPECT_GT(result.places[0].score, 0.4);
  EXPECT_DOUBLE_EQ(result.ratio, result.places[1].score / result.places[0].score);
  for (std::size_t i = 1; i < result.places.size(); ++i) {
    EXPECT_GE(result.places[i - 1].score, result.places[i].score);
    EXPECT_GE(off_m(result.places[i], result.places[0].pose), 25) << "distinct";
  }
}

TEST(MapSearch, HeadingAndHeightMayBeOff) {
  for (const double sign : {-1.0, 1.0}) {
    Scene scene;
    scene.prior.pose.attitude.heading_rad += sign * radians(6);
    scene.prior.pose.agl_m *= 1 - sign * 0.08;
    scene.prior.heading_range_rad = radians(9);
    scene.prior.scale_range = 0.12;
    const SearchResult result = scene.search();
    ASSERT_FALSE(result.places.empty());
    EXPECT_LT(off_m(result.places[0], scene.truth), kGsd_m);
    EXPECT_NEAR(result.places[0].pose.attitude.heading_rad, scene.truth.attitude.heading_rad, radians(1.6));
    EXPECT_NEAR(result.places[0].pose.agl_m / scene.truth.agl_m, 1, 0.03);
    EXPECT_LT(result.ratio, 0.75);
  }
}

// The true place is not on the map: whatever is found is wrong, and the ratio must say so. A window of 200 m holds few
// places to compete, so that the ratio of wrong ones scatters below 0.8; it stays apart from a right one's.
TEST(MapSearch, ARemovedPlaceIsAmbiguous) {
  const double right = Scene().search().ratio;
  for (const std::uint64_t seed : {21U, 22U, 23U}) {
    Scene scene;
    scene.map = Landscape(seed, 230).map(kGsd_m, true);
    scene.prior.heading_range_rad = radians(6);
    const SearchResult result = scene.search();
    ASSERT_GE(result.places.size(), 2U);
    RecordProperty("ratio_" + std::to_string(seed), std::to_string(result.ratio));
    EXPECT_GT(result.ratio, right + 0.2) << seed;
    EXPECT_LT(result.places[0].score, 0.3) << seed;
  }
}

TEST(MapSearch, MaskedPlaceIsNotFound) {
  Scene scene;
  const cv::Point2d at = scene.map.pixel_from_plane(scene.truth.position);
  cv::Mat hole(scene.map.mask.size(), CV_8UC1, cv::Scalar(0));
  cv::circle(hole, {static_cast<int>(at.x), static_cast<int>(at.y)}, 75, cv::Scalar(255), cv::FILLED);
  scene.map.mask.setTo(0, hole);
  scene.map.image.setTo(0, hole);
  scene.prior.radius_m = 180;
  const SearchResult result = scene.search();
  EXPECT_TRUE(result.places.empty() || result.ratio > 0.8) << result.ratio;
}

// Partly off the map: what is there is enough.
TEST(MapSearch, TheMapMayEndUnderTheFrame) {
  Scene scene;
  const cv::Point2d at = scene.map.pixel_from_plane(scene.truth.position);
  const cv::Rect missing(static_cast<int>(at.x) + 40, 0, scene.map.mask.cols - static_cast<int>(at.x) - 40,
                         scene.map.mask.rows);
  scene.map.mask(missing).setTo(0);
  scene.map.image(missing).setTo(0);
  const SearchResult result = scene.search();
  ASSERT_FALSE(result.places.empty());
  EXPECT_LT(off_m(result.places[0], scene.truth), 1.5 * kGsd_m);
}

TEST(MapSearch, ATexturelessMapGivesNoMatch) {
  Scene scene;
  scene.map.image.setTo(128);
  const SearchResult result = scene.search();
  EXPECT_TRUE(result.places.empty() || result.ratio == 1);
}

TEST(MapSearch, ATexturelessFrameGivesNoMatch) {
  Scene scene;
  scene.picture.setTo(128);
  const SearchResult result = scene.search();
  EXPECT_TRUE(result.places.empty() || result.ratio > 0.9);
}

TEST(MapSearch, AWindowSmallerThanTheFrameGivesNoMatch) {
  Scene scene;
  const cv::Rect part(0, 0, 60, 60);
  scene.map.image = scene.map.image(part).clone();
  scene.map.mask = scene.map.mask(part).clone();
  EXPECT_TRUE(scene.search().places.empty());
}

TEST(MapSearch, AWideWindowIsSweptCoarselyAndStillExact) {
  Scene scene;
  scene.map = landscape().map(0.5);
  scene.prior.radius_m = 150;
  SearchOptions options;
  options.gsd_m = 0.7;  // 657 pixels: beyond the size that is swept at full resolution
  const SearchResult result = search_window(scene.picture, small_camera(), scene.map, scene.prior, options);
  ASSERT_FALSE(result.places.empty());
  EXPECT_LT(off_m(result.places[0], scene.truth), 0.7);
  EXPECT_LT(result.ratio, 0.75);
}

TEST(MapSearch, IsDeterministic) {
  Scene scene;
  scene.prior.radius_m = 40;
  const SearchResult one = scene.search(), two = scene.search();
  ASSERT_EQ(one.places.size(), two.places.size());
  EXPECT_EQ(one.ratio, two.ratio);
  for (std::size_t i = 0; i < one.places.size(); ++i) {
    EXPECT_EQ(one.places[i].score, two.places[i].score);
    EXPECT_EQ(one.places[i].pose.position.east_m, two.places[i].pose.position.east_m);
  }
}

TEST(MapSearch, StopsBeforeTheNextHeadingWhenCancelled) {
  Scene scene;
  scene.prior.radius_m = 40;
  scene.prior.heading_range_rad = radians(9);
  test::CancelAfter never(test::CancelAfter::kNever);
  const SearchResult whole = scene.search(never.cancel()), unasked = scene.search();
  ASSERT_FALSE(whole.places.empty());
  EXPECT_EQ(whole.places[0].score, unasked.places[0].score) << "asking changes nothing";
  EXPECT_EQ(whole.ratio, unasked.ratio);
  EXPECT_GT(never.asked(), 7) << "the sweep alone has seven headings";
  for (const int at : {1, 2, 7, never.asked()}) {
    test::CancelAfter after(at);
    EXPECT_THROW(scene.search(after.cancel()), Interrupted) << at;
    EXPECT_EQ(after.asked(), at) << "nothing is done after that";
  }
}

}  // namespace
}  // namespace nadir
