#include "flight/autopilot_link.hpp"

#include <gtest/gtest.h>

namespace nadir {
namespace {

TEST(LatencyHistogram, KnowsItsQuantiles) {
  LatencyHistogram histogram;
  EXPECT_EQ(histogram.quantile_s(0.5), 0);
  for (int i = 0; i < 100; ++i) histogram.add((i + 0.5) / 1000);
  EXPECT_EQ(histogram.count(), 100U);
  EXPECT_DOUBLE_EQ(histogram.quantile_s(0.5), 0.050);
  EXPECT_DOUBLE_EQ(histogram.quantile_s(0.95), 0.095);
  EXPECT_DOUBLE_EQ(histogram.largest_s(), 0.0995);
}

TEST(LatencyHistogram, WhatIsBeyondItCountsAtItsEnd) {
  LatencyHistogram histogram;
  histogram.add(60);
  histogram.add(-1);
  EXPECT_EQ(histogram.quantile_s(1), 2);
  EXPECT_DOUBLE_EQ(histogram.quantile_s(0.5), 0.001);
  EXPECT_EQ(histogram.largest_s(), 60);
}

}  // namespace
}  // namespace nadir
