#include "estimation/anchor_acceptance.hpp"

#include <gtest/gtest.h>

namespace nadir {
namespace {

const Eigen::Vector2d kHere = Eigen::Vector2d::Zero();

bool vote(AnchorVotes& votes, double east_m, double north_m, const Quorum& quorum = {}) {
  return votes.vote({east_m, north_m}, kHere, quorum);
}

TEST(AnchorVotes, ThreeThatAgreeAreEnough) {
  AnchorVotes votes;
  EXPECT_FALSE(vote(votes, 100, 50));
  EXPECT_FALSE(vote(votes, 110, 60));
  EXPECT_TRUE(vote(votes, 95, 45));
}

TEST(AnchorVotes, OthersInBetweenDoNotMatterButTime) {
  AnchorVotes votes;
  EXPECT_FALSE(vote(votes, 100, 50));
  EXPECT_FALSE(vote(votes, -700, 3));
  EXPECT_FALSE(vote(votes, 101, 50));
  votes.abstain(kHere);
  EXPECT_TRUE(vote(votes, 99, 52)) << "the first of five still counts";
  AnchorVotes late;
  EXPECT_FALSE(vote(late, 100, 50));
  EXPECT_FALSE(vote(late, 101, 50));
  for (int i = 0; i < 4; ++i) late.abstain(kHere);
  EXPECT_FALSE(vote(late, 100, 50)) << "too long ago";
}

TEST(AnchorVotes, AgainstAnAnchorItTakesSixOfEight) {
  const Quorum quorum{.required_votes = AnchorVotes::kVotesAgainstAnchors};
  AnchorVotes votes;
  for (int i = 0; i < 3; ++i) EXPECT_FALSE(vote(votes, 200, 0, quorum)) << i;
  votes.abstain(kHere);
  votes.abstain(kHere);
  for (int i = 0; i < 2; ++i) EXPECT_FALSE(vote(votes, 205, 3, quorum)) << i;
  EXPECT_TRUE(vote(votes, 201, 1, quorum));
  AnchorVotes late;
  for (int i = 0; i < 5; ++i) EXPECT_FALSE(vote(late, 200, 0, quorum)) << i;
  for (int i = 0; i < 3; ++i) late.abstain(kHere);
  EXPECT_FALSE(vote(late, 200, 0, quorum)) << "five of the last eight";
}

TEST(AnchorVotes, DisagreementIsNoVote) {
  AnchorVotes votes;
  for (int i = 0; i < 20; ++i) EXPECT_FALSE(vote(votes, 26.0 * i, 0)) << i;
}

TEST(AnchorVotes, PicturesOfTheSameGroundAreOneVoice) {
  const Quorum quorum{.min_separation_m = 150};
  AnchorVotes votes;
  for (int i = 0; i < 3; ++i) EXPECT_FALSE(votes.vote({40, 0}, {60.0 * i, 0}, quorum)) << i;
  EXPECT_TRUE(votes.vote({40, 0}, {180, 0}, quorum));
}

// Three pictures a second, 7 m apart, of which each shows 500 m: eight attempts in a row are two seconds, and one voice.
TEST(AnchorVotes, HoweverManyPicturesThereAreItTakesTheSameWay) {
  for (const int voices : {AnchorVotes::kVotes, AnchorVotes::kVotesAgainstAnchors}) {
    const Quorum quorum{.required_votes = voices, .min_separation_m = 400};
    AnchorVotes votes;
    double way_m = 0;
    for (int i = 0; !votes.vote({40, 0}, {way_m, 0}, quorum); ++i) {
      ASSERT_LT(way_m, 600) << voices;
      way_m += 7;
      if (i % 4 == 3) votes.abstain({way_m, 0});
    }
    EXPECT_GE(way_m, 400) << voices;
  }
}

TEST(AnchorVotes, WhatIsRememberedIsBounded) {
  AnchorVotes votes;
  const Quorum quorum{.min_separation_m = 100};
  EXPECT_FALSE(votes.vote({40, 0}, {0, 0}, quorum));
  EXPECT_FALSE(votes.vote({40, 0}, {60, 0}, quorum));
  for (int i = 0; i < 100'000; ++i) votes.abstain({90, 0});
  EXPECT_FALSE(votes.vote({40, 0}, {120, 0}, quorum));
}

TEST(AnchorVotes, InASmallWindowTheyMustAgreeCloser) {
  EXPECT_EQ(AnchorVotes::agree_in_window_m(1200), AnchorVotes::kAgree_m);
  EXPECT_NEAR(AnchorVotes::agree_in_window_m(60), 6.8, 0.1);
  const Quorum quorum{.agreement_radius_m = AnchorVotes::agree_in_window_m(60)};
  AnchorVotes votes;
  EXPECT_FALSE(vote(votes, 40, 0, quorum));
  EXPECT_FALSE(vote(votes, 44, 0, quorum));
  EXPECT_FALSE(vote(votes, 48, 0, quorum)) << "the first is 8 m off";
}

TEST(AnchorVotes, ABreakForgets) {
  AnchorVotes votes;
  vote(votes, 1, 1);
  vote(votes, 1, 1);
  votes.clear();
  EXPECT_FALSE(vote(votes, 1, 1));
  EXPECT_FALSE(vote(votes, 1, 1));
  EXPECT_TRUE(vote(votes, 1, 1));
}

}  // namespace
}  // namespace nadir
