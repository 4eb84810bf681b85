// Levels of drawn flights: the start, gaps, doubt, and that they are the same each time.
#include "navigability/protection_forecast.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

#include "base/progress.hpp"

namespace nadir {
namespace {

constexpr double kWay_m = 44, kSpeed_mps = 22;

ForecastSetup setup_of(int threads = 2) {
  ForecastSetup setup;
  setup.uncertainty = {.heading_rad = 0.044, .agl_relative = 0.03, .tilt_rad = 0.014};
  setup.area = {-500, -500, 4500, 500};
  setup.threads = threads;
  return setup;
}

std::vector<ForecastFrame> straight(std::size_t number, double agl_m,
                                    const std::function<double(std::size_t)>& probability) {
  std::vector<ForecastFrame> frames(number);
  for (std::size_t i = 0; i < number; ++i) {
    ForecastFrame& frame = frames[i];
    frame.place = {kWay_m * static_cast<double>(i), 0};
    frame.agl_m = agl_m;
    frame.along_m = 0.72 * agl_m;
    frame.footprint_m = 0.96 * agl_m;
    frame.fine_gsd_m = 0.4;
    frame.map_sigma_m = 0.6;
    frame.way_m = i > 0 ? kWay_m : 0;
    frame.seconds = frame.way_m / kSpeed_mps;
    frame.probability = probability(i);
  }
  return frames;
}

std::vector<ForecastLevel> forecast(const std::vector<ForecastFrame>& frames, const ForecastSetup& setup = setup_of()) {
  NoProgress progress;
  return forecast_levels(frames, setup, progress);
}

double level_of(const ForecastLevel& level) { return level.hpl_m.value_or(1e9); }

TEST(ProtectionForecast, AStartIsConfirmedByLooksThatAgree) {
  const auto levels = forecast(straight(20, 150, [](std::size_t) { return 0.98; }));
  EXPECT_GT(level_of(levels[0]), 100) << "one look does not always overrule the doubt of a start";
  EXPECT_GT(levels[0].beyond_share, 0.2);
  EXPECT_LT(level_of(levels[8]), 40);
  EXPECT_LT(levels[8].beyond_share, 0.1);
  EXPECT_EQ(levels[8].since_anchor_m, 0);
  EXPECT_LT(levels[0].anchored_share, levels[8].anchored_share);
  EXPECT_GE(levels[8].anchored_share, 0.95);
}

TEST(ProtectionForecast, AStartOverPoorGroundStaysUnconfirmed) {
  const auto levels = forecast(straight(12, 150, [](std::size_t i) { return i < 8 ? 0.05 : 0.98; }));
  EXPECT_FALSE(levels[6].hpl_m);
  EXPECT_GT(levels[6].beyond_share, 0.5);
  EXPECT_LT(levels[11].beyond_share, levels[6].beyond_share);
}

TEST(ProtectionForecast, WithoutLooksTheLevelGrowsAndOverlapSlowsIt) {
  const auto gap = [](std::size_t i) { return i < 20 || i >= 50 ? 0.98 : 0.0; };
  const auto high = forecast(straight(60, 200, gap)), low = forecast(straight(60, 60, gap));
  for (std::size_t i = 24; i < 49; ++i) EXPECT_LE(level_of(high[i]), level_of(high[i + 1]) + 1e-3) << i;
  EXPECT_GT(level_of(high[49]), 2 * level_of(high[19]));
  EXPECT_GT(level_of(low[49]), 2 * level_of(high[49])) << "frames from 60 m do not overlap";
  EXPECT_GT(low[49].beyond_share, 0.9);
  EXPECT_NEAR(high[49].since_anchor_m, 30 * kWay_m, 1e-3);
  EXPECT_LT(level_of(high[55]), 100);
}

// Over water a frame shows nothing that the next one could be compared with, however much of it they share.
TEST(ProtectionForecast, OverBareGroundOverlapDoesNotHelp) {
  const auto gap = [](std::size_t i) { return i < 20 || i >= 35 ? 0.98 : 0.0; };
  auto changed = straight(45, 200, gap), water = changed;
  for (std::size_t i = 20; i < 35; ++i) water[i].bare = true;
  const auto tracked = forecast(changed), untracked = forecast(water);
  EXPECT_EQ(tracked[19].hpl_m, untracked[19].hpl_m);
  EXPECT_GT(level_of(untracked[34]), 2 * level_of(tracked[34]));
  EXPECT_LT(level_of(untracked[42]), 100) << "found again behind it";
}

// Without a velocity and without overlap σ grows by 20 m and more a frame: after twenty the window is the widest there
// is.
TEST(ProtectionForecast, WhoIsLostIsNotFoundAgain) {
  const auto levels = forecast(straight(40, 60, [](std::size_t i) { return i < 25 ? 0.0 : 0.98; }));
  EXPECT_GT(levels.back().beyond_share, 0.9);
  EXPECT_LT(levels.back().anchored_share, 0.1);
  const auto soon = forecast(straight(40, 60, [](std::size_t i) { return i < 4 ? 0.0 : 0.98; }));
  EXPECT_LT(soon.back().beyond_share, 0.1);
}

TEST(ProtectionForecast, AnchoredItGrowsWithTheHeightAndTheMapsError) {
  const auto good = [](std::size_t) { return 0.99; };
  const double low_m = level_of(forecast(straight(25, 110, good)).back());
  const double high_m = level_of(forecast(straight(25, 280, good)).back());
  EXPECT_GT(high_m, 1.5 * low_m);
  auto coarse = straight(25, 110, good);
  for (ForecastFrame& frame : coarse) frame.map_sigma_m = 5;
  EXPECT_GT(level_of(forecast(coarse).back()), low_m + 10);
}

TEST(ProtectionForecast, ASmallerRiskHasALargerLevel) {
  const auto frames = straight(25, 150, [](std::size_t) { return 0.98; });
  ForecastSetup lax = setup_of();
  lax.integrity_risk = 1e-3;
  EXPECT_LT(level_of(forecast(frames, lax).back()), level_of(forecast(frames).back()));
}

TEST(ProtectionForecast, ThreadsDoNotMatterAndNoFramesHaveNoLevels) {
  const auto frames = straight(15, 60, [](std::size_t i) { return i % 3 == 0 ? 0.3 : 0.9; });
  const auto one = forecast(frames, setup_of(1)), three = forecast(frames, setup_of(3));
  ASSERT_EQ(one.size(), three.size());
  for (std::size_t i = 0; i < one.size(); ++i) {
    EXPECT_EQ(one[i].hpl_m, three[i].hpl_m);
    EXPECT_EQ(one[i].beyond_share, three[i].beyond_share);
    EXPECT_EQ(one[i].anchored_share, three[i].anchored_share);
  }
  EXPECT_TRUE(forecast({}).empty());
  EXPECT_EQ(forecast(straight(1, 150, [](std::size_t) { return 1.0; })).size(), 1U);
}

}  // namespace
}  // namespace nadir
