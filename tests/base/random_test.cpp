#include "base/random.hpp"

#include <gtest/gtest.h>

namespace nadir {
namespace {

TEST(Random, TheSameSeedGivesTheSameNumbers) {
  // std::mt19937_64 with seed 5489 gives 9981545732273789042 as its 10000th number (the C++ standard, [rand.predef]).
  std::mt19937_64 engine(5489);
  engine.discard(9999);
  EXPECT_EQ(engine(), 9981545732273789042ULL);
  Random a(7), b(7), c(8);
  const double first = a.uniform();
  EXPECT_EQ(first, b.uniform());
  EXPECT_NE(first, c.uniform());
}

TEST(Random, ForksDoNotDependOnDraws) {
  Random a(7), b(7);
  a.uniform();
  EXPECT_EQ(a.fork("trees").uniform(), b.fork("trees").uniform());
  EXPECT_NE(a.fork("trees").uniform(), a.fork("roofs").uniform());
  EXPECT_NE(a.fork("trees", 1).uniform(), a.fork("trees", 2).uniform());
}

TEST(Random, DistributionsHaveTheExpectedMoments) {
  Random random(1);
  constexpr int kDraws = 200'000;
  double sum = 0, squares = 0, uniform = 0;
  std::array<int, 4> counts{};
  for (int i = 0; i < kDraws; ++i) {
    const double normal = random.normal(3, 2);
    sum += normal;
    squares += normal * normal;
    uniform += random.uniform(-1, 5);
    ++counts.at(static_cast<std::size_t>(random.integer(2, 5) - 2));
  }
  const double mean = sum / kDraws;
  EXPECT_NEAR(mean, 3, 0.02);
  EXPECT_NEAR(squares / kDraws - mean * mean, 4, 0.06);
  EXPECT_NEAR(uniform / kDraws, 2, 0.02);
  for (const int count : counts) EXPECT_NEAR(count, kDraws / 4, kDraws / 100);
}

}  // namespace
}  // namespace nadir
