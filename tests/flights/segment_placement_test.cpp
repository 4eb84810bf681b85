// Segments as wholes: their shape, and their place on maps that show it, show it as it was, or do not show it.
#include "flights/segment_placement.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cstdio>

#include "base/error.hpp"
#include "flights/segment_world.hpp"
#include "geodesy/angles.hpp"

namespace nadir {
namespace {

using namespace test;

double worst_error_m(const SegmentPlacementResult& result, const SegmentWorld::Segment& segment) {
  double worst_m = 0;
  for (std::size_t i = 0; i < result.poses.size(); ++i) {
    worst_m = std::max(worst_m, distance_m(result.poses[i].position, segment.truth[i].position));
  }
  return worst_m;
}

TEST(SegmentShape, IsTheTrackButForItsPlaceHeadingAndScale) {
  const SegmentWorld world(1, {});
  const auto segment = world.segment(0, 10);
  ASSERT_EQ(segment.shape.frames.size(), 10U);
  EXPECT_LT(segment.shape.turn_sigma_rad, radians(3));
  for (std::size_t i = 0; i < 10; ++i) {
    const Eigen::Vector2d truth = segment.truth[i].position - segment.truth[0].position;
    EXPECT_LT((segment.shape.frames[i].offset_m - truth).norm(), 0.04 * truth.norm() + 2) << i;
    EXPECT_TRUE(segment.shape.frames[i].usable);
  }
}

TEST(SegmentShape, KnowsTheTurnsOfTheImagesWhereNoHeadingIsMeasured) {
  const SegmentWorld world(2, {});
  const auto segment = world.segment(1, 8, false);
  ASSERT_EQ(segment.shape.frames.size(), 8U);
  EXPECT_GT(segment.shape.turn_sigma_rad, 1);
  const double begin_rad = segment.shape.frames[0].attitude.heading_rad - segment.truth[0].attitude.heading_rad;
  for (std::size_t i = 1; i < 8; ++i) {
    const double off_rad = segment.shape.frames[i].attitude.heading_rad - segment.truth[i].attitude.heading_rad;
    EXPECT_LT(std::abs(wrap_pi(off_rad - begin_rad)), radians(3)) << i;
    const double length_m = (segment.truth[i].position - segment.truth[0].position).norm();
    EXPECT_NEAR(segment.shape.frames[i].offset_m.norm(), length_m, 0.05 * length_m + 2);
  }
}

// Half of the land has changed since the map was made.
const WorldOptions kOldMap{.half_side_m = 420, .changed_share = 0.5};

void expect_right(const SegmentPlacementResult& result, const SegmentWorld::Segment& segment) {
  ASSERT_EQ(result.poses.size(), segment.shape.frames.size());
  EXPECT_LT(worst_error_m(result, segment), 5);
  for (std::size_t i = 0; i < result.poses.size(); ++i) {
    const SegmentSimilarity::Pose& pose = result.poses[i];
    const Eigen::Vector2d off = pose.position - segment.truth[i].position;
    EXPECT_LT(off.dot(pose.covariance_m2.inverse() * off), 18) << i;  // 99.99 %
    EXPECT_LT(std::sqrt(pose.covariance_m2.trace() / 2), 8) << i;
    EXPECT_LT(std::abs(wrap_pi(pose.heading_rad - segment.truth[i].attitude.heading_rad)), radians(3)) << i;
  }
  EXPECT_LE(result.doubt, 1e-3);
  EXPECT_GE(result.hits, 2);
}

struct PlacedSegment {
  explicit PlacedSegment(std::uint64_t seed) : world(seed, kOldMap) {}

  SegmentWorld world;
  SegmentWorld::Segment segment = world.segment(1, 9);
  SegmentPlacementResult result = world.place(segment, MapHole::none);
};

const PlacedSegment& placed_at_once() {
  static const PlacedSegment placed(1);
  return placed;
}

TEST(SegmentPlacement, FindsTheSegmentOnAMapThatIsHalfOld) {
  expect_right(placed_at_once().result, placed_at_once().segment);
  const PlacedSegment another(2);
  expect_right(another.result, another.segment);
}

TEST(SegmentPlacement, FindsItsHeadingWhereNoneWasMeasured) {
  const SegmentWorld world(4, kOldMap);
  const auto segment = world.segment(1, 9, false);
  ASSERT_GT(segment.shape.turn_sigma_rad, 1);
  expect_right(world.place(segment, MapHole::none), segment);
}

// A wrong position that is given with confidence is the worst.
TEST(SegmentPlacement, PlacesNothingWhereTheMapDoesNotShowIt) {
  for (const MapHole hole : {MapHole::blank, MapHole::other_land}) {  // many more seeds: ./run bench segments
    const SegmentWorld world(5, kOldMap);
    const auto segment = world.segment(2, 8);
    const auto result = world.place(segment, hole);
    EXPECT_TRUE(result.poses.empty()) << worst_error_m(result, segment) << " m off";
    EXPECT_LE(result.candidates.size(), 5U);
    double before = 1;
    for (const PlaceCandidateOfFrame& candidate : result.candidates) {
      EXPECT_LE(candidate.posterior, before);
      before = candidate.posterior;
      EXPECT_TRUE(candidate.likeness >= 0 && candidate.likeness <= 1 && candidate.radius_m >= 50);
    }
  }
}

TEST(SegmentPlacement, SearchesWhereItIsSaidToBeFirstAndBelievesNobody) {
  const SegmentWorld world(8, kOldMap);
  const auto segment = world.segment(3, 8);
  const PlaceStatement right{segment.observed[4].frame, segment.truth[4].position, 80};
  const auto found = world.place(segment, MapHole::none, {right});
  expect_right(found, segment);
  EXPECT_LT(found.candidates.size(), 5U) << "the area was not searched";
  const PlaceStatement wrong{4, segment.truth[4].position + Eigen::Vector2d(-250, 60), 80};
  expect_right(world.place(segment, MapHole::none, {wrong}), segment);
}

TEST(SegmentPlacement, IsCancelledAndGoesOnWithTheSameResult) {
  const auto& [world, segment, whole] = placed_at_once();
  const auto tiles = world.map(MapHole::none, segment);
  const FlatGround flat;
  const auto matcher = make_channel_matcher({world.camera().camera, *tiles, world.frame(), flat});
  SegmentPlacement placement(segment.shape,
                             {.camera = world.camera(),
                              .matcher = *matcher,
                              .area = world.area(),
                              .places = nullptr,
                              .read = [](std::size_t frame) { return placed_at_once().segment.images[frame]; }},
                             {}, {});
  for (int polls = 1;; polls = polls < 3 ? polls + 1 : 1) {  // in each step once or more
    int left = polls;
    try {
      if (!placement.step(Cancel([&left] { return --left == 0; }))) break;
    } catch (const Interrupted&) {
      if (!placement.step()) break;
    }
  }
  const auto result = placement.result();
  EXPECT_EQ(result.log_odds, whole.log_odds);
  ASSERT_EQ(result.poses.size(), whole.poses.size());
  EXPECT_EQ(result.poses.back().position, whole.poses.back().position);
}

TEST(SegmentPlacement, NeedsGroundAndPictures) {
  const SegmentWorld world(10, kOldMap);
  auto segment = world.segment(1, 8);
  EXPECT_TRUE(SegmentPlacement::possible(segment.shape, world.camera().camera));
  auto few = segment.shape;
  few.frames.resize(3);
  EXPECT_FALSE(SegmentPlacement::possible(few, world.camera().camera)) << "no ground and a half";
  auto unfit = segment.shape;
  for (ShapeFrame& frame : unfit.frames) frame.usable = false;
  EXPECT_FALSE(SegmentPlacement::possible(unfit, world.camera().camera));
  EXPECT_FALSE(SegmentPlacement::possible({}, world.camera().camera));
  for (cv::Mat& image : segment.images) image.release();  // they cannot be decoded any more
  EXPECT_TRUE(world.place(segment, MapHole::none).poses.empty());
}

}  // namespace
}  // namespace nadir
