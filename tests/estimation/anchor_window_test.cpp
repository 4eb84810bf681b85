#include "estimation/search_window.hpp"

#include <gtest/gtest.h>

namespace nadir {
namespace {

LocalizerConfig config() {
  LocalizerConfig c;
  c.min_search_radius_m = 60;
  c.max_search_radius_m = 600;
  c.area = PlaneBox{-1000, -500, 1000, 500};
  return c;
}

void expect_box(const PlaneBox& box, double west, double south, double east, double north) {
  EXPECT_DOUBLE_EQ(box.west_m, west);
  EXPECT_DOUBLE_EQ(box.south_m, south);
  EXPECT_DOUBLE_EQ(box.east_m, east);
  EXPECT_DOUBLE_EQ(box.north_m, north);
}

TEST(SearchWindow, ThreeSigmasWithinLimits) {
  const SearchWindow window(config());
  EXPECT_DOUBLE_EQ(window.radius_m(5), 60);
  EXPECT_DOUBLE_EQ(window.radius_m(50), 150);
  EXPECT_DOUBLE_EQ(window.radius_m(5000), 600);
}

TEST(SearchWindow, GrowsWithFramesThatFitNowhere) {
  SearchWindow window(config());
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

TEST(SearchWindow, WhereThereIsNoMapNothingSpeaksAgainstThePrediction) {
  SearchWindow window(config());
  for (int i = 0; i < 40; ++i) window.record_attempt(AnchorVerdict::no_map);
  EXPECT_DOUBLE_EQ(window.radius_m(5), 60);
}

TEST(SearchWindow, LostWhenNoWindowSurelyHoldsThePlace) {
  const SearchWindow window(config());
  EXPECT_TRUE(window.lost(false, 1));
  EXPECT_FALSE(window.lost(true, 199));
  EXPECT_TRUE(window.lost(true, 201));
  LocalizerConfig nowhere = config();
  nowhere.area.reset();
  EXPECT_FALSE(SearchWindow(nowhere).lost(true, 5000)) << "there is no area to search";
}

TEST(SearchWindow, WhatOfTheAreaIsLeft) {
  const SearchWindow window(config());
  expect_box(window.reachable_area(false, {0, 0}, 1), -1000, -500, 1000, 500);
  expect_box(window.reachable_area(true, {900, 0}, 100), 600, -300, 1000, 300);
  expect_box(window.reachable_area(true, {9000, 0}, 100), -1000, -500, 1000, 500);
}

// 2000 x 1000 m: two squares. 5000 x 1500: four.
TEST(SearchWindow, SearchesLargeAreasInParts) {
  SearchWindow window(config());
  const PlaneBox area{-1000, -500, 1000, 500};
  expect_box(window.next_part(area, {300, 0}), 0, -500, 1000, 500);
  expect_box(window.next_part(area, {300, 0}), -1000, -500, 0, 500);
  expect_box(window.next_part(area, {300, 0}), 0, -500, 1000, 500);
  window.record_attempt(AnchorVerdict::accepted);
  expect_box(window.next_part(area, {-300, 0}), -1000, -500, 0, 500);

  SearchWindow other(config());
  double searched_m2 = 0;
  for (int i = 0; i < 4; ++i) {
    const PlaneBox part = other.next_part({0, 0, 5000, 1500}, {5000, 700});
    EXPECT_DOUBLE_EQ(part.east_m, 5000 - 1250 * i);
    searched_m2 += (part.east_m - part.west_m) * (part.north_m - part.south_m);
  }
  EXPECT_DOUBLE_EQ(searched_m2, 5000.0 * 1500);
}

}  // namespace
}  // namespace nadir
