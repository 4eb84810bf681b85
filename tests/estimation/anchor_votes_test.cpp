#include "estimation/anchor_votes.hpp"

#include <gtest/gtest.h>

namespace nadir {
namespace {

TEST(AnchorVotes, ThreeThatAgreeAreEnough) {
  AnchorVotes votes;
  EXPECT_FALSE(votes.vote({100, 50}));
  EXPECT_FALSE(votes.vote({110, 60}));
  EXPECT_TRUE(votes.vote({95, 45}));
}

TEST(AnchorVotes, OthersInBetweenDoNotMatterButTime) {
  AnchorVotes votes;
  EXPECT_FALSE(votes.vote({100, 50}));
  EXPECT_FALSE(votes.vote({-700, 3}));
  EXPECT_FALSE(votes.vote({101, 50}));
  votes.abstain();
  EXPECT_TRUE(votes.vote({99, 52})) << "the first of five still counts";
  AnchorVotes late;
  EXPECT_FALSE(late.vote({100, 50}));
  EXPECT_FALSE(late.vote({101, 50}));
  for (int i = 0; i < 4; ++i) late.abstain();
  EXPECT_FALSE(late.vote({100, 50})) << "too long ago";
}

TEST(AnchorVotes, AgainstAnAnchorItTakesSixOfEight) {
  AnchorVotes votes;
  const int needed = AnchorVotes::kNeededAgainstAnchors;
  for (int i = 0; i < 3; ++i) EXPECT_FALSE(votes.vote({200, 0}, needed)) << i;
  votes.abstain();
  votes.abstain();
  for (int i = 0; i < 2; ++i) EXPECT_FALSE(votes.vote({205, 3}, needed)) << i;
  EXPECT_TRUE(votes.vote({201, 1}, needed));
  AnchorVotes late;
  for (int i = 0; i < 5; ++i) EXPECT_FALSE(late.vote({200, 0}, needed)) << i;
  for (int i = 0; i < 3; ++i) late.abstain();
  EXPECT_FALSE(late.vote({200, 0}, needed)) << "five of the last eight";
}

TEST(AnchorVotes, DisagreementIsNoVote) {
  AnchorVotes votes;
  for (int i = 0; i < 20; ++i) EXPECT_FALSE(votes.vote({26.0 * i, 0})) << i;
}

TEST(AnchorVotes, ABreakForgets) {
  AnchorVotes votes;
  votes.vote({1, 1});
  votes.vote({1, 1});
  votes.forget();
  EXPECT_FALSE(votes.vote({1, 1}));
  EXPECT_FALSE(votes.vote({1, 1}));
  EXPECT_TRUE(votes.vote({1, 1}));
}

}  // namespace
}  // namespace nadir
