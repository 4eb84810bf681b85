// Matchability against detection: the fit finds what there is, and nothing where there is nothing.
#include "bench/look_detection.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "base/random.hpp"

namespace nadir::bench {
namespace {

// Eight grounds of different odds, on which classes differ by these factors.
ProbedLooks drawn(const DetectionOdds& odds, std::uint64_t seed) {
  Random random(seed);
  ProbedLooks looks;
  for (std::uint64_t i = 0; i < 8000; ++i) {
    const auto ground = i % 8;
    const double kind = random.uniform();
    const MatchClass cls = kind < 0.6 ? MatchClass::good : kind < 0.8 ? MatchClass::weak : MatchClass::poor;
    const double factor = cls == MatchClass::good ? odds.good : cls == MatchClass::weak ? odds.weak : odds.poor;
    const double all = (1.0 + static_cast<double>(ground)) * factor;
    looks[i] = {i, "painted " + std::to_string(ground), 120, random.chance(all / (1 + all)), {.cls = cls}};
  }
  return looks;
}

TEST(LookDetection, TheFitFindsWhatTheClassesSay) {
  const ProbedLooks training = drawn({2, 1, 0.25}, 1), unseen = drawn({2, 1, 0.25}, 2);
  const DetectionOdds odds = fitted_odds(training);
  EXPECT_NEAR(std::log(odds.good / odds.poor), std::log(8.0), 0.25);
  EXPECT_NEAR(std::log(odds.weak / odds.poor), std::log(4.0), 0.25);
  const DetectionGain gain = gain_of(unseen, odds);
  EXPECT_GT(gain.nats, 0.02);
  EXPECT_GT(gain.nats, 3 * gain.sigma_nats);
}

TEST(LookDetection, ClassesThatSayNothingGainNothing) {
  const DetectionOdds odds = fitted_odds(drawn({1, 1, 1}, 3));
  EXPECT_NEAR(std::log(odds.good), 0, 0.15);
  EXPECT_NEAR(std::log(odds.poor), 0, 0.25);
  EXPECT_LT(std::abs(gain_of(drawn({1, 1, 1}, 4), odds).nats), 0.003);
}

// Factors that are wrong lose: the figure can be negative.
TEST(LookDetection, WrongFactorsLose) { EXPECT_LT(gain_of(drawn({2, 1, 0.25}, 5), {0.25, 1, 2}).nats, -0.05); }

TEST(LookDetection, ManagesWithoutLooksAndWithoutMisses) {
  EXPECT_EQ(detection_tables({}, fitted_odds({})), "no clear look in its place\n");
  ProbedLooks found;
  for (std::uint64_t i = 0; i < 5; ++i) found[i] = {i, "painted 1", 120, true, {.cls = MatchClass::poor}};
  const DetectionOdds odds = fitted_odds(found);
  EXPECT_EQ(odds.good, 1) << "no look of this class";
  EXPECT_TRUE(std::isfinite(odds.poor));
  EXPECT_THAT(detection_tables(found, odds),
              testing::AllOf(testing::HasSubstr("5 of 5"), testing::Not(testing::HasSubstr("nan"))));
}

TEST(LookDetection, OnlyClearLooksInTheirPlaceCount) {
  Look look;
  look.window = "right", look.picture = "clear";
  EXPECT_TRUE(shows_detection(look));
  look.picture = "old";
  EXPECT_FALSE(shows_detection(look));
  look.picture = "clear", look.window = "elsewhere";
  EXPECT_FALSE(shows_detection(look));
}

}  // namespace
}  // namespace nadir::bench
