#include "estimation/search_window.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <utility>
#include <vector>

namespace nadir {
namespace {

const PlaneBox kMissionArea{-1000, -500, 1000, 500};

void expect_box(const std::optional<PlaneBox>& box, double west, double south, double east, double north) {
  ASSERT_TRUE(box);
  EXPECT_DOUBLE_EQ(box->west_m, west);
  EXPECT_DOUBLE_EQ(box->south_m, south);
  EXPECT_DOUBLE_EQ(box->east_m, east);
  EXPECT_DOUBLE_EQ(box->north_m, north);
}

TEST(SearchWindow, FiveSigmasOfAStartThenThreeWithinLimits) {
  SearchWindow window(60, 600, kMissionArea);
  EXPECT_DOUBLE_EQ(window.radius_m(5), 60);
  EXPECT_DOUBLE_EQ(window.radius_m(50), 250);
  EXPECT_DOUBLE_EQ(window.radius_m(5000), 600);
  window.record_attempt(AnchorVerdict::accepted);
  EXPECT_DOUBLE_EQ(window.radius_m(5), 60);
  EXPECT_DOUBLE_EQ(window.radius_m(50), 150);
  EXPECT_DOUBLE_EQ(window.radius_m(5000), 600);
}

TEST(SearchWindow, GrowsWithFramesThatMatchNowhere) {
  SearchWindow window(60, 600, kMissionArea);
  double last = window.radius_m(5);
  for (int i = 0; i < 40; ++i) {
    window.record_attempt(i % 2 == 0 ? AnchorVerdict::few_inliers : AnchorVerdict::ambiguous);
    EXPECT_GE(window.radius_m(5), last);
    last = window.radius_m(5);
  }
  EXPECT_DOUBLE_EQ(last, 300);
  window.record_attempt(AnchorVerdict::no_map);
  EXPECT_DOUBLE_EQ(window.radius_m(5), 300);
  window.record_attempt(AnchorVerdict::accepted);
  EXPECT_DOUBLE_EQ(window.radius_m(5), 60);
}

TEST(SearchWindow, WithoutMapNothingContradictsThePrediction) {
  SearchWindow window(60, 600, kMissionArea);
  for (int i = 0; i < 40; ++i) window.record_attempt(AnchorVerdict::no_map);
  EXPECT_DOUBLE_EQ(window.radius_m(5), 60);
}

TEST(SearchWindow, LostWhenNoWindowIsCertainToContainThePlace) {
  const SearchWindow window(60, 600, kMissionArea);
  EXPECT_TRUE(window.lost(false, 1));
  EXPECT_FALSE(window.lost(true, 199));
  EXPECT_TRUE(window.lost(true, 201));
  EXPECT_FALSE(SearchWindow(60, 600, std::nullopt).lost(true, 5000)) << "there is no area to search";
}

TEST(SearchWindow, ReachableArea) {
  const SearchWindow window(60, 600, kMissionArea);
  expect_box(window.reachable_area(false, {0, 0}, 1), -1000, -500, 1000, 500);
  expect_box(window.reachable_area(true, {900, 0}, 100), 600, -300, 1000, 300);
  expect_box(window.reachable_area(true, {9000, 0}, 100), -1000, -500, 1000, 500);
}

// 2000 x 1000 m: two squares. 5000 x 1500: four.
TEST(SearchWindow, SearchesLargeAreasInParts) {
  SearchWindow window(60, 600, kMissionArea);
  const PlaneBox area{-1000, -500, 1000, 500};
  expect_box(window.next_part(area, {300, 0}), 0, -500, 1000, 500);
  expect_box(window.next_part(area, {300, 0}), -1000, -500, 0, 500);
  expect_box(window.next_part(area, {300, 0}), 0, -500, 1000, 500);
  window.record_attempt(AnchorVerdict::accepted);
  expect_box(window.next_part(area, {-300, 0}), -1000, -500, 0, 500);

  SearchWindow other(60, 600, kMissionArea);
  double searched_m2 = 0;
  for (int i = 0; i < 4; ++i) {
    const PlaneBox part = other.next_part({0, 0, 5000, 1500}, {5000, 700});
    EXPECT_DOUBLE_EQ(part.east_m, 5000 - 1250 * i);
    searched_m2 += (part.east_m - part.west_m) * (part.north_m - part.south_m);
  }
  EXPECT_DOUBLE_EQ(searched_m2, 5000.0 * 1500);
}

TEST(OperatorHint, IsSearchedWithinItsRadius) {
  const OperatorHint hint({200, 100}, 150);
  EXPECT_FALSE(hint.propagating());
  expect_box(hint.box({0, 0}, 900, std::nullopt), 50, -50, 350, 250);
}

TEST(OperatorHint, IsNeverSoNarrowThatNothingCompetes) {
  expect_box(OperatorHint({200, 100}, 0.5).box({0, 0}, 900, std::nullopt), 100, 0, 300, 200);
}

// 3-4-5: the variance grew by 30 squared; three sigma are 90 m.
TEST(OperatorHint, IsPropagatedByOdometryAndGrows) {
  OperatorHint hint({200, 100}, 150);
  hint.start_propagation({-700, 40}, 40);
  EXPECT_TRUE(hint.propagating());
  expect_box(hint.box({-700, 40}, 40, std::nullopt), 50, -50, 350, 250);
  expect_box(hint.box({-690, 20}, 50, std::nullopt), 60 - 90, -70 - 90, 360 + 90, 230 + 90);
  expect_box(hint.box({-700, 40}, 10, std::nullopt), 50, -50, 350, 250);
}

TEST(OperatorHint, EndsWhereTheAreaEnds) {
  expect_box(OperatorHint({900, 450}, 200).box({0, 0}, 9, kMissionArea), 700, 250, 1000, 500);
  EXPECT_FALSE(OperatorHint({1300, 0}, 200).box({0, 0}, 9, kMissionArea));
  EXPECT_FALSE(OperatorHint({0, -1e7}, 200).box({0, 0}, 9, kMissionArea));
}

}  // namespace
}  // namespace nadir
