// The belief over places: what looks make of it, and that no sequence of looks breaks it.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "base/random.hpp"
#include "estimation/belief.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {
namespace {

using namespace parameters::belief;

constexpr PlaneBox kArea{-1000, -1000, 1000, 1000};

Eigen::Matrix2d circle(double sigma_m) { return sigma_m * sigma_m * Eigen::Matrix2d::Identity(); }

TrackPrediction track(PlanePoint at, double sigma_m, bool stands = true) { return {at, circle(sigma_m), stands}; }

Look look_at(PlanePoint middle, double radius_m, std::optional<PlanePoint> found, double log_ratio,
             double new_ground = 1) {
  Look look;
  look.window = {middle.east_m - radius_m, middle.north_m - radius_m, middle.east_m + radius_m,
                 middle.north_m + radius_m};
  if (found) look.candidate = LookCandidate{*found, circle(4), log_ratio};
  look.new_ground = new_ground;
  return look;
}

// A flight to and fro, a footprint a look; each look finds the truth plus `off`.
struct LookFlight {
  PlaceBelief belief;
  double sigma_m;
  bool stands = true;
  double step_m = 150;
  PlanePoint at{0, 0};

  LookResult fly(std::optional<Eigen::Vector2d> off, double log_ratio, double new_ground = 1) {
    if (std::abs(at.east_m) > 700) step_m = at.east_m > 0 ? -150 : 150;
    at.east_m += step_m * new_ground;
    std::optional<PlanePoint> found;
    if (off) found = PlanePoint(at.vector() + *off);
    return belief.update(look_at(at, 150, found, log_ratio, new_ground), track(at, sigma_m, stands));
  }
};

LookFlight known_start(double sigma_m = 8) { return {PlaceBelief(kStartDoubt, kArea), sigma_m}; }

TEST(Belief, AClearLookWhereItIsExpectedMovesTheTrack) {
  LookFlight flight = known_start();
  const LookResult result = flight.fly(Eigen::Vector2d(3, -2), 8);
  EXPECT_TRUE(result.accepted);
  EXPECT_LT(result.chi2, 1);
  EXPECT_GT(flight.belief.track_probability(), 1 - kMaxPlaceDoubt);
}

// ---- Matchability of the ground

Look with_odds(Look look, double west, double east) {
  look.detection_odds = [=](const PlanePoint& place) { return place.east_m < 0 ? west : east; };
  return look;
}

// What is left of a track of these odds to be seen when a look at its place finds nothing.
double track_after_a_miss(std::optional<double> odds) {
  PlaceBelief belief(0.1, kArea);
  Look look = look_at({0, 0}, 150, std::nullopt, 0);
  if (odds) look = with_odds(look, *odds, *odds);
  belief.update(look, track({0, 0}, 8));
  return belief.track_probability();
}

TEST(Belief, ALookOverPoorGroundThatFindsNothingSaysLessAndOverGoodGroundMore) {
  EXPECT_LT(track_after_a_miss(kGoodDetectionOdds), track_after_a_miss(std::nullopt));
  EXPECT_GT(track_after_a_miss(kPoorDetectionOdds), track_after_a_miss(std::nullopt));
  EXPECT_LT(track_after_a_miss(kPoorDetectionOdds), 0.9) << "it still says something";
}

TEST(Belief, GroundOfNoClassChangesNothing) { EXPECT_EQ(track_after_a_miss(1), track_after_a_miss(std::nullopt)); }

// The track over poor ground, a place of the same weight over good ground: finding nothing speaks against the place.
TEST(Belief, EachHypothesisHasTheOddsOfItsOwnGround) {
  const auto place_after_a_miss = [](double odds) {
    PlaceBelief belief(kStartDoubt, kArea);
    belief.update(look_at({0, 0}, 150, PlanePoint(100, 0), 3), track({-20, 0}, 8, false));
    EXPECT_EQ(belief.places(), 1U);
    Look look = with_odds(look_at({0, 0}, 150, std::nullopt, 0), odds, 1 / odds);
    belief.update(look, track({-20, 0}, 8, false));
    return 1 - belief.track_probability() - belief.elsewhere_probability();
  };
  EXPECT_LT(place_after_a_miss(0.2), place_after_a_miss(1));
  EXPECT_GT(place_after_a_miss(5), place_after_a_miss(1));
}

// However extreme the factors, weights stay weights.
TEST(Belief, ExtremeOddsBreakNothing) {
  for (const double odds : {1e-12, 1e12}) {
    LookFlight flight = known_start(30);
    for (int i = 0; i < 40; ++i) {
      Look look = look_at(flight.at, 150, i % 3 == 0 ? std::nullopt : std::optional(PlanePoint(40.0 * (i % 5), 0)), 4);
      flight.belief.update(with_odds(look, odds, 1 / odds), track(flight.at, 30));
      const double sum = flight.belief.track_probability() + flight.belief.elsewhere_probability();
      ASSERT_TRUE(sum >= 0 && sum <= 1 + 1e-9) << i << " " << odds;
    }
  }
}

TEST(Belief, AVagueLookMovesNothingAndIsRemembered) {
  LookFlight flight = known_start(50);
  const LookResult first = flight.fly(Eigen::Vector2d(40, 0), 2);
  EXPECT_FALSE(first.accepted);
  EXPECT_EQ(flight.belief.places(), 1U);
}

TEST(Belief, LooksAtNewGroundThatAgreeMoveTheTrackTogether) {
  LookFlight flight = known_start(50);
  int looks = 1;
  while (!flight.fly(Eigen::Vector2d(40, 0), 4).accepted) ASSERT_LT(++looks, 5);
  EXPECT_GT(looks, 1);
}

// A vague look after one that left a sharp place: the place lies beyond what the candidate's error explains.
LookResult look_beside_a_place(double distance_m) {
  PlaceBelief belief(kStartDoubt, kArea);
  belief.update(look_at({0, 0}, 60, PlanePoint(distance_m, 0), 4), track({0, 0}, 20));
  EXPECT_EQ(belief.places(), 1U);
  return belief.update(look_at({0, 0}, 60, PlanePoint(0, 0), 7), track({0, 0}, 20));
}

TEST(Belief, APlaceThatTheNextLookSearchesAsWellIsNoDoubt) {
  EXPECT_LT(look_beside_a_place(22).place_doubt, kMaxPlaceDoubt);
  EXPECT_GT(look_beside_a_place(45).place_doubt, kMaxPlaceDoubt);
}

TEST(Belief, PlacesGrowAsTheTrackDoesThatOdometryPropagates) {
  PlaceBelief belief(kStartDoubt, kArea);
  belief.update(look_at({0, 0}, 150, PlanePoint(60, 0), 2), track({0, 0}, 30));
  ASSERT_EQ(belief.places(), 1U);
  const double seen_m = *belief.protection_level_m(circle(30), 1e-2, circle(0));
  for (int i = 0; i < 50; ++i) belief.on_odometry({0, 0}, circle(30 + 0.001 * i));
  EXPECT_NEAR(*belief.protection_level_m(circle(30.05), 1e-2, circle(0)), seen_m, 3);
}

TEST(Belief, AFlightThatFindsItsPlaceExpectsToFindIt) {
  const auto far_look = [](LookFlight& flight) {
    return flight.belief.update(look_at({0, 0}, 1000, PlanePoint(30, 0), 6), track({0, 0}, 400, false));
  };
  LookFlight fresh = known_start(), found = known_start();
  for (int i = 0; i < 20; ++i) EXPECT_TRUE(found.fly(Eigen::Vector2d(0, 0), 6).accepted) << i;
  const double doubt = far_look(found).place_doubt;
  EXPECT_LT(doubt, far_look(fresh).place_doubt / 3);
}

TEST(Belief, APlaceWhereTheTrackIsBecomesTheTrack) {
  LookFlight flight = known_start();
  flight.fly(Eigen::Vector2d(1, 1), 0);
  ASSERT_EQ(flight.belief.places(), 1U);
  flight.fly(std::nullopt, 0);
  EXPECT_EQ(flight.belief.places(), 0U);
  EXPECT_NEAR(flight.belief.track_probability() + flight.belief.elsewhere_probability(), 1, 1e-12);
}

TEST(Belief, LooksAtTheSameGroundAreOneWitness) {
  LookFlight flight = known_start(50);
  flight.fly(Eigen::Vector2d(60, 0), 3);
  for (int i = 0; i < 100; ++i) EXPECT_FALSE(flight.fly(Eigen::Vector2d(60, 0), 3, 0).accepted) << i;
}

TEST(Belief, ChancePeaksThatScatterMoveNothing) {
  Random random(5);
  LookFlight flight = known_start(50);
  for (int i = 0; i < 200; ++i) {
    const Eigen::Vector2d off(random.uniform(-150, 150), random.uniform(-150, 150));
    EXPECT_FALSE(flight.fly(off, random.uniform(-4, 2)).accepted) << i;
  }
}

TEST(Belief, WithoutAPositionOneLookIsNotEnough) {
  LookFlight flight{PlaceBelief(1, kArea), 1000, false};
  const auto everywhere = [&](PlanePoint found) {
    Look look = look_at({0, 0}, 1000, found, 6);
    return flight.belief.update(look, track({0, 0}, 1000, false));
  };
  EXPECT_FALSE(everywhere({300, 200}).accepted);
  EXPECT_EQ(flight.belief.track_probability(), 0);
  EXPECT_FALSE(flight.belief.protection_level_m(circle(1000), kIntegrityRisk, circle(0)));
  EXPECT_TRUE(everywhere({300, 200}).accepted);
  EXPECT_TRUE(flight.belief.protection_level_m(circle(5), kIntegrityRisk, circle(0)));
}

// However often: the map may be displaced as well.
TEST(Belief, LooksNeverOverruleAStartThatTheyContradict) {
  LookFlight flight = known_start();
  for (int i = 0; i < 50; ++i) EXPECT_FALSE(flight.fly(Eigen::Vector2d(0, 80), 8).accepted) << i;
  const Eigen::Matrix2d spread = flight.belief.spread_m2(circle(8));
  EXPECT_GT(std::sqrt(spread(1, 1)), 60) << "the published ellipse covers both";
}

TEST(Belief, AfterAHintTheyDo) {
  LookFlight flight = known_start();
  for (int i = 0; i < 5; ++i) flight.fly(Eigen::Vector2d(0, 80), 8);
  flight.belief.on_hint({flight.at + Eigen::Vector2d(0, 80), 40}, track(flight.at, 8));
  EXPECT_TRUE(flight.fly(Eigen::Vector2d(0, 80), 8).accepted);
}

// ---- Hints

constexpr double kAnyRisk = 1e-5;

PlaceBelief without_start() { return PlaceBelief(1, kArea); }
TrackPrediction unknown_track() { return track({0, 0}, 1000, false); }

// Everywhere is searched.
LookResult find(PlaceBelief& belief, PlanePoint found, double log_ratio) {
  return belief.update(look_at({0, 0}, 1000, found, log_ratio), unknown_track());
}

TEST(Belief, OneClearLookConfirmsAHintAndThereIsAProtectionLevel) {
  PlaceBelief hinted = without_start();
  hinted.on_hint({{300, 200}, 75}, unknown_track());
  EXPECT_FALSE(hinted.protection_level_m(circle(5), kAnyRisk, circle(0))) << "a hint is no position";
  EXPECT_TRUE(find(hinted, {340, 180}, 6).accepted);
  EXPECT_TRUE(hinted.protection_level_m(circle(5), kAnyRisk, circle(0)));
  PlaceBelief unhinted = without_start();
  EXPECT_FALSE(find(unhinted, {340, 180}, 6).accepted);
}

TEST(Belief, AHintAfterTheLookCountsAsMuch) {
  PlaceBelief belief = without_start();
  EXPECT_TRUE(find(belief, {340, 180}, 8).accepted);
  const TrackPrediction found = track({340, 180}, 5);
  EXPECT_FALSE(belief.protection_level_m(found.covariance_m2, kAnyRisk, circle(0)));
  belief.on_hint({{300, 200}, 75}, found);
  EXPECT_LT(belief.protection_level_m(found.covariance_m2, kAnyRisk, circle(0)).value_or(1e9), 100);
}

TEST(Belief, AWrongHintCostsLooks) {
  PlaceBelief hinted = without_start();
  hinted.on_hint({{-600, -600}, 75}, unknown_track());
  int looks = 1;
  while (!find(hinted, {340, 180}, 6).accepted) ASSERT_LT(++looks, 4);
  EXPECT_GT(looks, 1);
}

TEST(Belief, AHintThatIsRepeatedSaysNothingMore) {
  PlaceBelief once = without_start(), often = without_start();
  once.on_hint({{300, 200}, 75}, unknown_track());
  for (int i = 0; i < 20; ++i) often.on_hint({{300, 200}, 75}, unknown_track());
  EXPECT_NEAR(often.elsewhere_probability(), once.elsewhere_probability(), 1e-12);
  // Nor about a start that it contradicts, or repeats.
  for (const double off_m : {0.0, 500.0}) {
    PlaceBelief first(kStartDoubt, kArea), further(kStartDoubt, kArea);
    first.on_hint({{off_m, 0}, 75}, track({0, 0}, 50));
    for (int i = 0; i < 20; ++i) further.on_hint({{off_m, 0}, 75}, track({0, 0}, 50));
    EXPECT_NEAR(further.track_probability(), first.track_probability(), 1e-12) << off_m;
    EXPECT_NEAR(further.elsewhere_probability(), first.elsewhere_probability(), 1e-12) << off_m;
  }
}

TEST(Belief, ALaterHintMovesThePlaceOfAnEarlierOne) {
  PlaceBelief belief = without_start();
  belief.on_hint({{-600, 0}, 75}, unknown_track());
  belief.on_hint({{300, 200}, 75}, unknown_track());
  EXPECT_EQ(belief.places(), 1U);
  EXPECT_TRUE(find(belief, {300, 200}, 6).accepted);
}

TEST(Belief, AHintThatAgreesMakesNoStartSurer) {
  PlaceBelief belief(kStartDoubt, kArea);
  const double before = belief.track_probability();
  belief.on_hint({{20, 0}, 75}, track({0, 0}, 50));
  EXPECT_NEAR(belief.track_probability(), before, 1e-12);
  EXPECT_FALSE(belief.protection_level_m(circle(50), kAnyRisk, circle(0)));
}

TEST(Belief, AHintHardlyShakesWhatTheMapHasConfirmed) {
  LookFlight flight = known_start();
  for (int i = 0; i < 5; ++i) ASSERT_TRUE(flight.fly(Eigen::Vector2d(0, 0), 6).accepted);
  flight.belief.on_hint({flight.at + Eigen::Vector2d(600, 0), 75}, track(flight.at, 8));
  EXPECT_GT(flight.belief.track_probability(), 0.99);
}

TEST(Belief, AStartFromBeforeARestartIsOverruled) {
  LookFlight flight = known_start();
  flight.stands = false;
  int looks = 1;
  while (!flight.fly(Eigen::Vector2d(0, 80), 8).accepted) ASSERT_LT(++looks, 6);
}

TEST(Belief, AnEarlierAnchorIsOverruledAfterSomeFootprints) {
  LookFlight flight = known_start();
  const LookResult agrees = flight.fly(Eigen::Vector2d(0, 0), 8);
  ASSERT_TRUE(agrees.accepted);
  EXPECT_FALSE(agrees.contradicted);
  int looks = 1;
  LookResult result = flight.fly(Eigen::Vector2d(0, 80), 8);
  for (; !result.accepted; result = flight.fly(Eigen::Vector2d(0, 80), 8)) ASSERT_LT(++looks, 20);
  EXPECT_GE(looks, kOverrulingFootprints);
  EXPECT_TRUE(result.contradicted);
}

// What many footprints of ground supported was no accident of the matcher: one of two scenes is displaced, and which
// one nobody on board can know. Where the first one is seen again, the track is.
TEST(Belief, WhatMuchGroundSupportedIsNotOverruledByADisplacedMap) {
  LookFlight flight = known_start();
  for (int i = 0; i < 2 * kOverrulingFootprints; ++i) ASSERT_TRUE(flight.fly(Eigen::Vector2d(0, 0), 8).accepted) << i;
  const auto level_m = [&] {
    return flight.belief.protection_level_m(circle(8), kIntegrityRisk, circle(0)).value_or(1e9);
  };
  ASSERT_LT(level_m(), 60);
  for (int i = 0; i < 50; ++i) {
    flight.belief.propagate(8);
    EXPECT_FALSE(flight.fly(Eigen::Vector2d(100, 60), 8).accepted) << i;
    if (i >= 3) {
      EXPECT_GT(level_m(), 117) << i;
    }
  }
  int looks = 1;
  while (!flight.fly(Eigen::Vector2d(0, 0), 8).accepted) ASSERT_LT(++looks, 4);
}

// As odometry goes on, the track may come to be there. That it was found far away says that the track's past is wrong:
// whoever took the distance for odometry's drift would carry a wrong drift on.
TEST(Belief, APlaceInsideTheGrownEllipseOfTheTrackContradictsItNoLonger) {
  LookFlight flight = known_start();
  for (int i = 0; i < 2 * kOverrulingFootprints; ++i) ASSERT_TRUE(flight.fly(Eigen::Vector2d(0, 0), 8).accepted) << i;
  for (int i = 0; i < 20; ++i) {
    flight.belief.propagate(8);
    EXPECT_FALSE(flight.fly(Eigen::Vector2d(0, 60), 8).accepted) << i;
  }
  flight.sigma_m = 40;
  int looks = 1;
  LookResult result = flight.fly(Eigen::Vector2d(0, 60), 8);
  for (; !result.accepted; result = flight.fly(Eigen::Vector2d(0, 60), 8)) ASSERT_LT(++looks, 4);
  EXPECT_LT(result.chi2, kChi2_95);
  EXPECT_TRUE(result.contradicted);
}

// Of a place hundreds of metres wide a weak candidate near the track is hardly a part: what is left of a flight that
// was lost stays as wide as it was, and so does the level.
TEST(Belief, AWeakCandidateDoesNotCarryAWidePlaceAway) {
  PlaceBelief belief(kStartDoubt, kArea);
  const TrackPrediction lost = track({0, 0}, 300, false);
  belief.update(look_at({0, 0}, 900, PlanePoint(600, 0), 2), lost);
  ASSERT_TRUE(belief.update(look_at({0, 0}, 900, PlanePoint(600, 0), 3, 0.6), lost).accepted);
  belief.on_anchor({600, 0}, circle(300), circle(3));
  const auto level_m = [&] {
    return belief.protection_level_m(circle(3), 1e-5, Eigen::Matrix2d::Zero()).value_or(1e9);
  };
  const double before_m = level_m();
  ASSERT_GT(before_m, 600);
  for (const PlanePoint weak : {PlanePoint(590, 50), PlanePoint(615, -40), PlanePoint(640, 10)}) {
    belief.update(look_at({600, 0}, 60, weak, -0.7, 0.1), track({600, 0}, 3, false));
    EXPECT_GT(level_m(), 0.9 * before_m);
  }
}

TEST(Belief, AFrameThatDoesNotContinueTheTrackCannotMoveItAlone) {
  LookFlight flight = known_start(60);
  Look look = look_at({0, 0}, 180, PlanePoint{70, 0}, 8);
  look.continues_track = false;
  EXPECT_FALSE(flight.belief.update(look, track({0, 0}, 60)).accepted);
}

TEST(Belief, FindingNothingIsNoEvidenceForElsewhereWhereTheMapMayNotShowThePlace) {
  LookFlight flight = known_start();
  ASSERT_TRUE(flight.fly(Eigen::Vector2d(0, 0), 8).accepted);
  for (int i = 0; i < 100; ++i) EXPECT_FALSE(flight.fly(std::nullopt, 0).accepted);
  EXPECT_GT(flight.belief.track_probability(), 0.99);
}

TEST(ProtectionLevel, IsTheRayleighQuantileOfOneSharpTrackWithAHeavierTail) {
  const PlaceBelief sure(0, kArea);
  const double level_m = sure.protection_level_m(circle(3), 1e-5, circle(4)).value();
  EXPECT_NEAR(level_m, 5 * std::sqrt(-2 * kTailVarianceFactor * std::log(1e-5)), 1e-6);
}

TEST(ProtectionLevel, HoldsEveryPlaceThatCountsForMoreThanTheRisk) {
  LookFlight flight = known_start();
  ASSERT_TRUE(flight.fly(Eigen::Vector2d(0, 0), 8).accepted);
  const double alone_m = flight.belief.protection_level_m(circle(8), 1e-5, circle(0)).value_or(1e9);
  for (int i = 0; i < 2; ++i) flight.fly(Eigen::Vector2d(0, 120), 6);
  const auto both = flight.belief.protection_level_m(circle(8), 1e-5, circle(0));
  EXPECT_TRUE(!both || *both > 120);
  EXPECT_LT(alone_m, 60);
}

TEST(ProtectionLevel, GrowsWithTheTimeSinceTheLastLookUntilThereIsNone) {
  PlaceBelief belief(0, kArea);
  double before_m = 0;
  for (int minute = 0; minute < 10; ++minute) {
    const double level_m = belief.protection_level_m(circle(8), kIntegrityRisk, circle(0)).value();
    EXPECT_GT(level_m, before_m);
    before_m = level_m;
    belief.propagate(60);
  }
  belief.propagate(3600);
  EXPECT_FALSE(belief.protection_level_m(circle(8), kIntegrityRisk, circle(0)));
}

// ---- Motions that may be chance

constexpr double kVague_m = 40, kSharp_m2 = 9;
constexpr double kTurn_rad = 0.05;

// The track, sharp, has just been moved 50 m to the east by a motion that may be chance; without it, it would be
// anywhere.
struct UnconfirmedMotion {
  PlaceBelief belief{0, kArea};
  TrackPrediction track{{50, 0}, circle(3), true};

  explicit UnconfirmedMotion(double doubt) {
    MotionEvidence motion;
    motion.spread = kVague_m * kVague_m * kTurn_rad;
    motion.chi2 = 2;
    motion.doubt = doubt;
    motion.predicted = {10, 0};
    motion.covariance_m2 = circle(kVague_m);
    motion.velocity_mps = {-4, 0};
    motion.velocity_variance = 15 * 15;
    belief.on_motion(motion, track);
  }
  // A sure one.
  void next(double chi2) {
    MotionEvidence motion;
    motion.spread = kSharp_m2 * kTurn_rad;
    motion.chi2 = chi2;
    belief.on_motion(motion, track);
  }
  double level_m() const { return belief.protection_level_m(track.covariance_m2, kIntegrityRisk, circle(0)).value(); }
  PlaceBelief::PlaceState place() const { return belief.place_states(track.covariance_m2).at(0); }
};

TEST(UnconfirmedMotion, LeavesAPlaceWhereTheTrackWasPredicted) {
  const UnconfirmedMotion sure(0), unconfirmed(0.05);
  EXPECT_EQ(sure.belief.places(), 0U);
  ASSERT_EQ(unconfirmed.belief.places(), 1U);
  EXPECT_NEAR(unconfirmed.place().probability, 0.05, 1e-12);
  EXPECT_EQ(unconfirmed.place().offset_m, Eigen::Vector2d(-40, 0));
  EXPECT_NEAR(unconfirmed.place().covariance_m2(0, 0), kVague_m * kVague_m, 1e-9);
  EXPECT_LT(sure.level_m(), 20);
  EXPECT_GT(unconfirmed.level_m(), 150);
}

TEST(UnconfirmedMotion, ThePlaceGoesOnAsItWasPredictedUntilAMotionIsMeasured) {
  UnconfirmedMotion flight(0.05);
  flight.belief.propagate(2);
  EXPECT_EQ(flight.place().offset_m, Eigen::Vector2d(-48, 0));
  EXPECT_NEAR(flight.place().covariance_m2(1, 1), kVague_m * kVague_m + 30 * 30, 1e-9);
  flight.belief.propagate(1);
  EXPECT_EQ(flight.place().offset_m, Eigen::Vector2d(-52, 0));
  EXPECT_NEAR(flight.place().covariance_m2(1, 1), kVague_m * kVague_m + 45 * 45, 1e-9);
  flight.next(1);  // it measured the last second
  EXPECT_EQ(flight.place().offset_m, Eigen::Vector2d(-48, 0));
  EXPECT_NEAR(flight.place().covariance_m2(1, 1), kVague_m * kVague_m + 30 * 30, 1e-9);
  flight.belief.propagate(5);
  EXPECT_EQ(flight.place().offset_m, Eigen::Vector2d(-48, 0));
}

TEST(UnconfirmedMotion, TheNextOneThatFitsSettlesMostOfIt) {
  UnconfirmedMotion flight(0.05);
  flight.next(1);
  const double ratio = kSharp_m2 / (kVague_m * kVague_m) * std::exp(0.5);
  EXPECT_NEAR(flight.place().probability, 0.05 * ratio / (0.95 + 0.05 * ratio), 1e-9);
  const double once = flight.place().probability;
  flight.next(1);
  EXPECT_NEAR(flight.place().probability, once, 1e-12) << "what comes later fits both";
}

TEST(UnconfirmedMotion, TheNextOneThatDoesNotFitSpeaksForThePlace) {
  UnconfirmedMotion flight(0.05);
  flight.next(40);
  EXPECT_GT(flight.place().probability, 0.99);
  EXPECT_GT(flight.level_m(), 150);
}

TEST(UnconfirmedMotion, AnAnchorWhereTheTrackIsOutweighsIt) {
  UnconfirmedMotion flight(0.05);
  for (int i = 0; i < 3; ++i) flight.belief.update(look_at({50, 0}, 150, PlanePoint(51, 0), 6), flight.track);
  EXPECT_LT(flight.level_m(), 40);
}

// The track may be anywhere in the place, so that the place is not the track, however near its middle is.
TEST(Belief, APlaceThatIsMuchWiderThanTheTrackStaysAPlace) {
  LookFlight flight = known_start(40);
  ASSERT_TRUE(flight.fly(Eigen::Vector2d(1, 0), 8).accepted);
  flight.belief.on_anchor({0, 0}, circle(40), circle(3));
  flight.sigma_m = 3;
  ASSERT_GE(flight.belief.places(), 1U);
  const auto left = flight.belief.place_states(circle(3)).at(0);
  EXPECT_LT(left.offset_m.norm(), 3);
  flight.belief.update(look_at(flight.at, 150, std::nullopt, 0, 0), track(flight.at, 3));
  EXPECT_GE(flight.belief.places(), 1U);
}

// ---- The rival of a candidate: ground that resembles itself

Look with_rival(Look look, PlanePoint at, double log_ratio) {
  look.rival = LookCandidate{at, circle(8), log_ratio};
  return look;
}

// Looks from x = 0 on at new ground, of a track that hardly knows where it is along them.
struct AlikeRows {
  PlaceBelief belief{kStartDoubt, kArea};
  double east_m = -150;

  LookResult look(double candidate_north_m, double ratio, std::optional<double> rival_north_m, double rival_ratio) {
    east_m += 150;
    Look look = look_at({east_m, 0}, 150, PlanePoint{east_m, candidate_north_m}, ratio);
    if (rival_north_m) look = with_rival(look, {east_m, *rival_north_m}, rival_ratio);
    return belief.update(look, track({east_m, 0}, 40));
  }
};

TEST(Belief, OfTwoRowsThatLookAlikeNeitherIsTakenUntilALookTellsThemApart) {
  AlikeRows rows;
  EXPECT_FALSE(rows.look(30, 7, -30, 6).accepted);
  const auto level = rows.belief.protection_level_m(circle(40), kIntegrityRisk, circle(1));
  ASSERT_TRUE(level);
  EXPECT_GT(*level, 60) << "it holds both";
  EXPECT_TRUE(rows.look(-30, 7, std::nullopt, 0).accepted) << "the rival was the place";
  EXPECT_GT(rows.belief.track_probability(), 0.99);
}

TEST(Belief, WithoutItsRivalTheSameCandidateIsTakenAtOnce) {
  AlikeRows rows;
  EXPECT_TRUE(rows.look(30, 7, std::nullopt, 0).accepted);
  AlikeRows unlike;
  EXPECT_TRUE(unlike.look(30, 7, -30, 7 - 18).accepted) << "nor does a place matter that hardly looks like it";
}

TEST(Belief, ASharpTrackKnowsWhichOfTwoRowsItIsOver) {
  LookFlight flight = known_start(4);
  const Look alone = look_at({0, 0}, 60, PlanePoint{2, 1}, 7);
  PlaceBelief without = flight.belief, with = flight.belief;
  EXPECT_TRUE(without.update(alone, track({0, 0}, 4)).accepted);
  EXPECT_TRUE(with.update(with_rival(alone, {2, 51}, 6.5), track({0, 0}, 4)).accepted);
  EXPECT_NEAR(with.track_probability(), without.track_probability(), 1e-4);
}

TEST(Belief, ATrackThatIsWhereTheRivalIsKeepsItsWeight) {
  // The candidate speaks for a place 60 m beside; its rival says that the same picture is seen where the track is.
  const Look wrong = look_at({0, 0}, 120, PlanePoint{60, 0}, 7);
  PlaceBelief without(kStartDoubt, kArea), with(kStartDoubt, kArea);
  for (int i = 0; i < 3; ++i) {
    EXPECT_FALSE(without.update(wrong, track({0, 0}, 5)).accepted);
    EXPECT_FALSE(with.update(with_rival(wrong, {0, 0}, 6.5), track({0, 0}, 5)).accepted) << "a rival moves no track";
  }
  for (PlaceBelief* belief : {&without, &with}) {
    belief->update(look_at({0, 0}, 120, std::nullopt, 0), track({0, 0}, 5));
  }
  EXPECT_LT(without.track_probability(), 0.2);
  EXPECT_GT(with.track_probability(), 0.9);
}

TEST(Belief, NoSequenceOfLooksBreaksIt) {
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    Random random(seed);
    PlaceBelief belief(random.uniform(0, 1), kArea);
    PlanePoint at{0, 0};
    for (int i = 0; i < 60; ++i) {
      belief.propagate(random.uniform(-60, 600));
      at.east_m += random.uniform(-100, 300);
      std::optional<PlanePoint> found;
      if (random.chance(0.8)) found = PlanePoint{at.east_m + random.normal(0, 200), random.normal(0, 200)};
      Look look = look_at(at, random.uniform(1, 2000), found, random.uniform(-10, 10), random.uniform(0, 1));
      if (found && random.chance(0.5)) {
        look = with_rival(look, {found->east_m + random.normal(0, 60), found->north_m}, random.uniform(-30, 10));
      }
      look.continues_track = random.chance(0.7);
      const auto prediction = track(at, random.uniform(0.5, 2000), random.chance(0.5));
      if (random.chance(0.5)) {
        MotionEvidence motion;
        motion.spread = random.chance(0.1) ? 0 : random.uniform(1e-9, 1e6);
        motion.chi2 = random.uniform(0, 1e4);
        motion.doubt = random.chance(0.5) ? random.uniform(0, 1) : 0;
        motion.predicted = {at.east_m + random.normal(0, 300), random.normal(0, 300)};
        motion.covariance_m2 = circle(random.uniform(0.5, 2000));
        motion.velocity_mps = {random.normal(0, 50), random.normal(0, 50)};
        motion.velocity_variance = random.uniform(0, 1000);
        belief.on_odometry({random.normal(0, 10), random.normal(0, 10)}, prediction.covariance_m2);
        belief.on_motion(motion, prediction);
      }
      belief.update(look, prediction);
      if (random.chance(0.1)) {
        belief.on_hint({{at.east_m + random.normal(0, 300), random.normal(0, 300)}, random.uniform(1, 500)},
                       prediction);
      }
      ASSERT_GE(belief.track_probability(), 0);
      ASSERT_LE(belief.track_probability() + belief.elsewhere_probability(), 1 + 1e-9);
      ASSERT_LE(belief.places(), kMaxPlaces);
      ASSERT_TRUE(belief.spread_m2(prediction.covariance_m2).allFinite());
      const auto level = belief.protection_level_m(prediction.covariance_m2, kIntegrityRisk, circle(1));
      ASSERT_TRUE(!level || (std::isfinite(*level) && *level >= 0));
    }
  }
}

}  // namespace
}  // namespace nadir
