#include "upload/uploader.hpp"

#include <gtest/gtest.h>

#include <algorithm>

namespace nadir {
namespace {

TEST(BackOff, IsRandomUpToADoublingLimit) {
  Random random(1);
  for (int failures = 0; failures < 30; ++failures) {
    const std::int64_t limit_ms = std::min<std::int64_t>(900'000, std::int64_t{2'000} << std::min(failures, 20));
    std::int64_t least = limit_ms, most = 0;
    for (int draw = 0; draw < 500; ++draw) {
      const std::int64_t wait_ms = back_off_ms(failures, std::nullopt, random);
      least = std::min(least, wait_ms);
      most = std::max(most, wait_ms);
    }
    EXPECT_GE(least, 0);
    EXPECT_LT(most, limit_ms);
    EXPECT_LT(least, limit_ms / 10) << failures;
    EXPECT_GT(most, limit_ms - limit_ms / 10) << failures;
  }
}

TEST(BackOff, WhatTheServiceAsksForGoesFirst) {
  Random random(1);
  EXPECT_EQ(back_off_ms(9, 7, random), 7'000);
  EXPECT_EQ(back_off_ms(0, 0, random), 0);
  EXPECT_EQ(back_off_ms(0, 1'000'000, random), 86'400'000) << "a day at most";
  EXPECT_EQ(back_off_ms(0, -5, random), 0);
}

TEST(BackOff, IsTheSameForTheSameSeed) {
  Random one(42), other(42);
  for (int i = 0; i < 20; ++i) EXPECT_EQ(back_off_ms(i, std::nullopt, one), back_off_ms(i, std::nullopt, other));
}

}  // namespace
}  // namespace nadir
