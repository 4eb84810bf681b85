#include "estimation/anchor_acceptance.hpp"

#include <gtest/gtest.h>

namespace nadir {
namespace {

TEST(StartContradictions, WithoutAnyAMatchAnswersForItselfAlone) {
  EXPECT_EQ(StartContradictions().effective_chi2({50, 0}, 3, 8), 3);
}

// 50 m at a sigma of 8 m, while odometry makes the prediction vaguer.
TEST(StartContradictions, OneThatIsCarriedAlongWeighsWhatItWeighedAtItsWorst) {
  StartContradictions said;
  said.record({10, 49}, 27, 9.5);
  said.record({9, 48}, 18, 11);
  EXPECT_EQ(said.effective_chi2({9, 48}, 12.9, 13), 27);
  EXPECT_EQ(said.effective_chi2({9, 48}, 30, 13), 30) << "its own when that is worse";
  EXPECT_EQ(said.effective_chi2({-30, 5}, 4, 13), 4) << "another place";
}

TEST(StartContradictions, DriftMovesThePlaceByWhatTheTrackHasBecomeVaguer) {
  StartContradictions said;
  said.record({0, 60}, 30, 10);
  EXPECT_EQ(said.effective_chi2({0, 100}, 5, 10), 5);
  EXPECT_EQ(said.effective_chi2({0, 100}, 5, 16), 30);
}

TEST(StartContradictions, ChanceMatchesElsewhereDoNotDriveItOutSoon) {
  StartContradictions said;
  said.record({0, 60}, 30, 10);
  for (int i = 0; i < 7; ++i) said.record({100.0 + 60 * i, -200}, 20, 10);
  EXPECT_EQ(said.effective_chi2({0, 60}, 5, 10), 30);
  said.record({-300, 0}, 20, 10);
  EXPECT_EQ(said.effective_chi2({0, 60}, 5, 10), 5) << "memory is bounded";
}

TEST(StartContradictions, IsForgottenWhenSettled) {
  StartContradictions said;
  said.record({0, 60}, 30, 10);
  said.clear();
  EXPECT_EQ(said.effective_chi2({0, 60}, 5, 10), 5);
}

}  // namespace
}  // namespace nadir
