// Floating segments of stored flights: placed, taken back, interrupted.
#include "flights/segment_placer.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "flights/floating_flight.hpp"
#include "support/process.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using namespace test;
using Scope = SegmentPlacer::Scope;

const FlightEngineOptions kFixedClock{.clock = [] { return kNow; }, .keep_looks = true};

constexpr int kLeastFrames = 7;  // that show ground enough to be placed

std::vector<nlohmann::json> bodies(const FlightStore& store, FlightEventKind kind) {
  std::vector<nlohmann::json> bodies;
  for (const EventRow& row : store.events_after(0, 10'000)) {
    if (row.event.kind == kind) bodies.push_back(nlohmann::json::parse(row.event.body));
  }
  return bodies;
}

void place_all(FlightEngine& engine, Scope scope) {
  while (engine.place_segments(scope, 1000)) {
  }
}

// The shortest flight that can be placed, with its pictures processed: made once, copied for each test.
std::unique_ptr<FlightStore> floating_and_processed(const std::filesystem::path& folder) {
  static const TemporaryFolder made;
  static const bool once = [] {
    const auto store = floating_flight(made / "flight", kLeastFrames);
    FlightEngine(*store, floating_setup(), kFixedClock).process();
    return true;
  }();
  if (once) std::filesystem::copy(made / "flight", folder, std::filesystem::copy_options::recursive);
  return FlightStore::open(folder);
}

TEST(SegmentPlacer, MergesAFloatingSegmentAndShowsItsFramesAsRefined) {
  const TemporaryFolder temporary;
  const auto store = floating_flight(temporary / "flight");
  FlightEngine engine(*store, floating_setup(), kFixedClock);
  engine.process();
  ASSERT_EQ(store->segments().size(), 1U);
  ASSERT_EQ(store->segments()[0].state, SegmentState::floating);
  place_all(engine, Scope::closed);
  EXPECT_EQ(store->segments()[0].state, SegmentState::floating) << "another picture may continue it";
  place_all(engine, Scope::all);
  EXPECT_EQ(store->segments()[0].state, SegmentState::merged);
  const auto moments = floating_moments();
  const auto check = [&] {
    const auto refined = store->estimates(EstimateKind::refined);
    ASSERT_EQ(refined.size(), moments.size());
    for (std::size_t i = 0; i < moments.size(); ++i) {
      expect_sound(refined[i]);
      EXPECT_LT(off_m(refined[i], moments[i]), 4) << i;
      EXPECT_LT(refined[i].sigma_m, 8) << i;
      EXPECT_LT(off_m(refined[i], moments[i]), 4 * refined[i].sigma_m) << i;
    }
    EXPECT_EQ(store->estimates(EstimateKind::refined, 3, 1).size(), 1U);
  };
  check();
  engine.complete();
  check();
  for (std::size_t i = 0; i < moments.size(); ++i) EXPECT_LT(off_m(engine.refined()[i], moments[i]), 4);
  const auto merged = bodies(*store, FlightEventKind::segments_merged);
  ASSERT_EQ(merged.size(), 1U);
  EXPECT_EQ(merged[0]["segment"], 0);
  EXPECT_EQ(merged[0]["by"], "map");
  EXPECT_EQ(merged[0]["frames"], moments.size());
  EXPECT_GE(merged[0]["hits"], 2);
  EXPECT_LE(merged[0]["doubt"], 1e-3);
  const auto completed = bodies(*store, FlightEventKind::flight_completed);
  ASSERT_EQ(completed.size(), 1U);
  EXPECT_EQ(completed[0]["floating_segments"], 0);
  place_all(engine, Scope::all);
  EXPECT_EQ(bodies(*store, FlightEventKind::segments_merged).size(), 1U) << "once";
}

TEST(SegmentPlacer, WhatAPersonTakesBackFloatsForEver) {
  const TemporaryFolder temporary;
  {
    const auto store = floating_and_processed(temporary / "flight");
    FlightEngine engine(*store, floating_setup(), kFixedClock);
    engine.process();
    EXPECT_FALSE(store->take_back_merge(0, "test", kNow));
    place_all(engine, Scope::all);
    engine.complete();
    EXPECT_TRUE(store->take_back_merge(0, "test", kNow));
    EXPECT_FALSE(store->take_back_merge(0, "test", kNow));
    EXPECT_FALSE(store->take_back_merge(7, "test", kNow));
    EXPECT_EQ(store->segments()[0].state, SegmentState::floating);
    for (const Estimate& estimate : store->estimates(EstimateKind::refined)) EXPECT_FALSE(estimate.position);
    EXPECT_TRUE(store->placed_estimates().empty());
    EXPECT_EQ(bodies(*store, FlightEventKind::merge_withdrawn).size(), 1U);
  }
  const auto store = FlightStore::open(temporary / "flight");
  FlightEngine engine(*store, floating_setup(), kFixedClock);
  engine.process();
  place_all(engine, Scope::all);
  EXPECT_EQ(store->segments()[0].state, SegmentState::floating);
}

TEST(SegmentPlacer, WhatCannotBePlacedIsAskedOnceWithCandidates) {
  const TemporaryFolder temporary;
  for (int run = 0; run < 2; ++run) {
    const auto store = run == 0 ? floating_flight(temporary / "flight") : FlightStore::open(temporary / "flight");
    FlightEngine engine(*store, elsewhere_setup(), kFixedClock);
    engine.process();
    place_all(engine, Scope::all);
    EXPECT_EQ(store->segments()[0].state, SegmentState::floating);
    std::vector<nlohmann::json> asked;
    for (const auto& body : bodies(*store, FlightEventKind::user_input_needed)) {
      if (body.contains("looks")) asked.push_back(body);
    }
    ASSERT_EQ(asked.size(), 1U) << run;
    ASSERT_FALSE(asked[0]["candidates"].empty());
    EXPECT_LE(asked[0]["candidates"].size(), 5U);
    for (const auto& candidate : asked[0]["candidates"]) {
      for (const char* member : {"lat_deg", "lon_deg", "heading_deg", "likeness", "posterior", "radius_m"}) {
        EXPECT_TRUE(candidate[member].is_number()) << member;
      }
    }
  }
}

TEST(SegmentPlacer, ASegmentThatGoesOnFloatsAgainUntilItIsPlacedAgain) {
  const TemporaryFolder temporary;
  const auto store = floating_flight(temporary / "flight", kLeastFrames);
  FlightEngine engine(*store, floating_setup(), kFixedClock);
  engine.process();
  place_all(engine, Scope::all);
  ASSERT_EQ(store->segments()[0].state, SegmentState::merged);
  add_floating_pictures(*store, kLeastFrames, kLeastFrames + 2);
  EXPECT_EQ(engine.process(), 2U);
  EXPECT_EQ(store->segments()[0].state, SegmentState::floating);
  EXPECT_TRUE(store->placed_estimates().empty());
  place_all(engine, Scope::all);
  EXPECT_EQ(store->segments()[0].state, SegmentState::merged);
  EXPECT_EQ(store->placed_estimates().size(), 9U);
}

TEST(SegmentPlacer, IsCancelled) {
  const TemporaryFolder temporary;
  const auto store = floating_and_processed(temporary / "flight");
  FlightEngine engine(*store, floating_setup(), kFixedClock);
  engine.process();
  EXPECT_THROW(engine.place_segments(Scope::all, 1000, Cancel([] { return true; })), Interrupted);
  EXPECT_EQ(store->segments()[0].state, SegmentState::floating);
  place_all(engine, Scope::all);
  EXPECT_EQ(store->segments()[0].state, SegmentState::merged);
}

TEST(SegmentPlacer, KilledAtEveryCommitItEndsWithTheSameFlight) {
  const TemporaryFolder temporary;
  const auto fly = [&](const std::string& folder, int fatal_commit) {
    return run_process({NADIR_KILLED_FLIGHT, (temporary / folder).string(), "place", std::to_string(fatal_commit)})
        .code;
  };
  floating_flight(temporary / "whole", kLeastFrames).reset();
  ASSERT_EQ(fly("whole", 0), 0);
  floating_flight(temporary / "killed", kLeastFrames).reset();
  int kills = 0;
  for (int run = 0; run < 60; ++run) {
    if (fly("killed", run % 2 == 0 ? 1 : 2) == 0) break;
    ++kills;
  }
  EXPECT_GE(kills, 5);
  const auto whole = FlightStore::open(temporary / "whole"), killed = FlightStore::open(temporary / "killed");
  ASSERT_EQ(killed->segments().size(), 1U);
  EXPECT_EQ(killed->segments()[0].state, SegmentState::merged);
  EXPECT_EQ(written_out(*killed), written_out(*whole));
}

}  // namespace
}  // namespace nadir
