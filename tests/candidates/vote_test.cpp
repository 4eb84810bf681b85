#include "candidates/vote.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <set>

#include "candidates/flight_maker.hpp"

namespace nadir {
namespace {

const TileKey kVotedPlace = test::keys_in_a_row(1)[0];

class VoteTest : public ::testing::Test {
 protected:
  // day: of the capture; ground: which images agree.
  void add(const char* airframe, const char* flight, int day, int ground = 1, std::int64_t sigma_mm = 1'500) {
    AcceptedCandidate candidate;
    candidate.tile = static_cast<std::int64_t>(address_.candidates.size()) + 1;
    candidate.sidecar = template_;
    candidate.sidecar.airframe = airframe;
    candidate.sidecar.flight = flight;
    candidate.sidecar.captured_at = {(test::kNoon.unix_s + day * test::kDay_s) * 1000};
    candidate.sidecar.pose.sigma_mm = sigma_mm;
    address_.candidates.push_back(candidate);
    ground_[candidate.tile] = ground;
  }
  Outcome outcome() {
    return decide(
        address_,
        [this](const AcceptedCandidate& one, const AcceptedCandidate& other) {
          ++compared_;
          const bool forced = forced_agreements_.contains({one.tile, other.tile});
          return Vote{.correlation_ppm = 700'000, .agrees = forced || ground_.at(one.tile) == ground_.at(other.tile)};
        },
        0, rules_);
  }
  std::int64_t promoted() {
    const Outcome result = outcome();
    return result.promotion ? result.promotion->tile : 0;
  }

  CandidateSidecar template_ = test::FlightMaker().candidate(kVotedPlace).sidecar;
  CandidateRules rules_;
  AddressCandidates address_{.key = kVotedPlace};
  std::map<std::int64_t, int> ground_;
  std::set<std::pair<std::int64_t, std::int64_t>>
      forced_agreements_;  // agree whatever ground they show; the smaller id first
  int compared_ = 0;
};

TEST_F(VoteTest, OneFlightPromotesNothing) {
  EXPECT_EQ(promoted(), 0);
  add("a", "f1", 0);
  EXPECT_EQ(promoted(), 0);
  add("a", "f1", 0);
  add("a", "f1", 1);
  EXPECT_EQ(promoted(), 0) << "one flight counts once, however many tiles it has";
  add("a", "f2", 0);
  EXPECT_EQ(promoted(), 0) << "the same airframe on the same day";
}

TEST_F(VoteTest, TwoIndependentFlightsThatAgreePromoteTheBest) {
  add("a", "f1", 0, 1, 900);
  add("b", "f2", 0, 1, 1'500);
  const Outcome result = outcome();
  ASSERT_TRUE(result.promotion);
  EXPECT_EQ(result.promotion->tile, 1);
  EXPECT_EQ(result.promotion->flights, 2);
  const auto evidence = nlohmann::json::parse(result.promotion->evidence);
  EXPECT_EQ(evidence["needed"], 2);
  EXPECT_EQ(evidence["sigma_mm"], 1'500) << "the other one's";
  EXPECT_EQ(evidence["flights"].size(), 2U);
  EXPECT_EQ(evidence["flights"][0]["base_package"], template_.base_package.hex());
  EXPECT_EQ(evidence["flights"][0]["airframe"], "a") << "the newest first, ties by their order";
}

TEST_F(VoteTest, OneAirframePromotesNothingByDefault) {
  for (int day = 0; day < 20; ++day) add("a", ("f" + std::to_string(day)).c_str(), day);
  EXPECT_EQ(promoted(), 0) << "the holder of one key could promote anything";
  rules_.airframes_differ = false;
  EXPECT_NE(promoted(), 0);
}

// One key signs any number of flights, each newer than what the others saw.
TEST_F(VoteTest, ManyFlightsOfOneKeyDoNotDisplaceOthers) {
  add("a", "f1", 0);
  add("b", "f2", 0);
  for (int i = 0; i < 100; ++i) add("evil", ("e" + std::to_string(i)).c_str(), 1, 100 + i);
  for (const bool airframes_differ : {true, false}) {
    rules_.airframes_differ = airframes_differ;
    const std::int64_t tile = promoted();
    EXPECT_TRUE(tile == 1 || tile == 2) << tile;
  }
  EXPECT_LE(compared_, 2 * static_cast<int>(kMaxIndependentFlights * (kMaxIndependentFlights - 1) / 2));
}

// A stolen key's tile is made to agree with one genuine flight and with no other.
TEST_F(VoteTest, AnOutlierDoesNotSplitALargerGroup) {
  rules_.flights_to_promote = 3;
  add("a", "f1", 3);
  add("evil", "e", 2, 2);
  add("b", "f2", 1);
  add("c", "f3", 0);
  forced_agreements_.insert({1, 2});
  const Outcome result = outcome();
  ASSERT_TRUE(result.promotion);
  EXPECT_EQ(result.promotion->flights, 3);
  EXPECT_EQ(result.promotion->evidence.find("evil"), std::string::npos);
}

TEST_F(VoteTest, AFlightAcrossMidnightIsOneFlight) {
  rules_.airframes_differ = false;
  add("a", "f1", 0);
  add("a", "f2", 0);  // restarted in the air
  const std::int64_t midnight_ms = (test::kNoon.unix_s / test::kDay_s + 1) * test::kDay_s * 1000;
  for (const std::int64_t apart_ms : {std::int64_t{1'000}, std::int64_t{5} * 3600 * 1000}) {
    address_.candidates[0].sidecar.captured_at = {midnight_ms - apart_ms / 2};
    address_.candidates[1].sidecar.captured_at = {midnight_ms + apart_ms / 2};
    EXPECT_EQ(promoted(), 0) << apart_ms;
  }
  address_.candidates[1].sidecar.captured_at = {midnight_ms + 7 * 3'600'000};
  EXPECT_NE(promoted(), 0);
}

TEST_F(VoteTest, DisagreementPromotesNothing) {
  add("a", "f1", 0, 1);
  add("b", "f2", 0, 2);
  add("c", "f3", 0, 3);
  EXPECT_EQ(promoted(), 0);
}

TEST_F(VoteTest, TheRequiredNumberOfFlightsMustAllAgree) {
  rules_.flights_to_promote = 3;
  add("a", "f1", 0, 1);
  add("b", "f2", 0, 1);
  add("c", "f3", 0, 2);
  EXPECT_EQ(promoted(), 0);
  add("d", "f4", 0, 1);
  EXPECT_NE(promoted(), 0);
}

TEST_F(VoteTest, ChangedGroundWinsOnceEnoughFlightsShowIt) {
  add("a", "f1", 0, 1, 500);
  add("b", "f2", 0, 1, 500);
  add("a", "f3", 5, 2);
  EXPECT_LE(promoted(), 2) << "a single flight with new ground does not overrule the others";
  add("b", "f4", 6, 2);
  EXPECT_GE(promoted(), 3);
}

TEST_F(VoteTest, APromotedTileStaysPromoted) {
  add("a", "f1", 0, 1, 900);
  add("b", "f2", 0, 1);
  const auto promotion = outcome().promotion;
  ASSERT_TRUE(promotion);
  address_.promoted = promotion->tile, address_.evidence = promotion->evidence;
  EXPECT_FALSE(outcome().promotion);
  add("c", "f3", 0);
  const auto again = outcome().promotion;
  ASSERT_TRUE(again) << "a third flight corroborates it";
  EXPECT_EQ(again->tile, promotion->tile);
  EXPECT_EQ(again->flights, 3);
}

TEST_F(VoteTest, KnownComparisonsAreNotRepeatedAndTheWorkIsBounded) {
  add("a", "f1", 0);
  add("b", "f2", 0);
  address_.votes = outcome().new_votes;
  ASSERT_EQ(address_.votes.size(), 1U);
  compared_ = 0;
  EXPECT_TRUE(outcome().promotion);
  EXPECT_EQ(compared_, 0);
  for (int i = 0; i < 100; ++i) add(("x" + std::to_string(i)).c_str(), "f", 1, 100 + i);
  outcome();
  EXPECT_LE(compared_, static_cast<int>(kMaxIndependentFlights * (kMaxIndependentFlights - 1) / 2));
}

TEST_F(VoteTest, TheAllowedDisplacementFollowsTheUncertainty) {
  EXPECT_EQ(allowed_shift_mm(3'000, 4'000, rules_), 15'000);
  EXPECT_EQ(allowed_shift_mm(100, 100, rules_), rules_.floor_mm);
}

}  // namespace
}  // namespace nadir
