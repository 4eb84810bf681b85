// Floating segments placed by the ground that they share with others: from pictures of two passes that cross where
// there is no map.
#include "flights/shared_ground.hpp"

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

const FlightEngineOptions kClockAtNow{.clock = [] { return kNow; }, .keep_looks = true};

std::vector<EventRow> events(const FlightStore& store, FlightEventKind kind) {
  std::vector<EventRow> found;
  for (EventRow& row : store.events_after(0, 10'000)) {
    if (row.event.kind == kind) found.push_back(row);
  }
  return found;
}

nlohmann::json body(const EventRow& row) { return nlohmann::json::parse(row.event.body); }

void place_all(FlightEngine& engine) {
  while (engine.place_segments(Scope::all, 1000)) {
  }
}

// Of the frames of the second pass, of these estimates.
double largest_error_m(const FlightStore& store, EstimateKind kind) {
  double largest_m = 0;
  const auto estimates = store.estimates(kind);
  const auto moments = crossing_moments();
  for (std::size_t i = kSecondBegins; i < moments.size(); ++i) {
    largest_m = std::max(largest_m, off_m(estimates.at(i), moments[i]));
  }
  return largest_m;
}

// The crossing flight in three states, made once and copied for each test.
struct CrossingFlights {
  CrossingFlights() {
    {
      const auto store = crossing_flight(folder / "begun", crossing_moments());
      FlightEngine engine(*store, crossing_setup(), kClockAtNow);
      struct Enough {};
      try {
        engine.process({}, [](std::size_t frame, FrameReport&, bool) {
          if (frame + 3 == kSecondBegins + kSecondPass) throw Enough();
        });
      } catch (const Enough&) {
      }
    }
    copy_to("begun", folder / "processed");
    {
      const auto store = FlightStore::open(folder / "processed");
      FlightEngine(*store, crossing_setup(), kClockAtNow).process();
    }
    copy_to("processed", folder / "placed");
    const auto store = FlightStore::open(folder / "placed");
    FlightEngine engine(*store, crossing_setup(), kClockAtNow);
    place_all(engine);
  }
  void copy_to(const char* state, const std::filesystem::path& copy) const {
    std::filesystem::copy(folder / state, copy, std::filesystem::copy_options::recursive);
  }

  const TemporaryFolder folder;  // "begun": all frames but two; "processed": all; "placed"
};

void copy_flight(const char* state, const std::filesystem::path& folder) {
  static const CrossingFlights made;
  made.copy_to(state, folder);
}

std::unique_ptr<FlightStore> crossed_and_processed(const std::filesystem::path& folder) {
  copy_flight("processed", folder);
  return FlightStore::open(folder);
}

TEST(SharedGround, PlacesASegmentThatNoMapShows) {
  const TemporaryFolder temporary;
  const auto store = crossed_and_processed(temporary / "flight");
  FlightEngine engine(*store, crossing_setup(), kClockAtNow);
  auto segments = store->segments();
  ASSERT_EQ(segments.size(), 3U);
  EXPECT_EQ(segments[0].state, SegmentState::anchored);
  ASSERT_EQ(segments[2].state, SegmentState::floating);
  while (engine.place_segments(Scope::closed, 1000)) {
  }
  EXPECT_EQ(store->segments()[2].state, SegmentState::floating) << "not while pictures wait";
  place_all(engine);
  segments = store->segments();
  EXPECT_EQ(segments[0].state, SegmentState::anchored);
  ASSERT_EQ(segments[2].state, SegmentState::merged);
  const auto moments = crossing_moments();
  const auto refined = store->estimates(EstimateKind::refined);
  for (std::size_t i = kSecondBegins; i < moments.size(); ++i) {
    expect_sound(refined[i]);
    EXPECT_LT(off_m(refined[i], moments[i]), 5) << i;
    EXPECT_LT(off_m(refined[i], moments[i]), 3.5 * refined[i].sigma_m) << i;
    EXPECT_LT(refined[i].sigma_m, 8) << i;
    EXPECT_EQ(refined[i].source, SourceLabel::vo_extrapolated) << "its own picture was not matched with the map";
  }
  const auto merged = events(*store, FlightEventKind::segments_merged);
  ASSERT_EQ(merged.size(), 1U);
  EXPECT_EQ(merged[0].event.frame, std::size_t{kSecondBegins});
  EXPECT_EQ(body(merged[0])["segment"], 2);
  EXPECT_EQ(body(merged[0])["by"], "ground");
  EXPECT_EQ(body(merged[0])["onto"], nlohmann::json::array({0}));
  EXPECT_EQ(body(merged[0])["frames"], kSecondPass);
  EXPECT_GE(body(merged[0])["hits"], 2);
  engine.complete();
  EXPECT_LT(largest_error_m(*store, EstimateKind::refined), 5);
  place_all(engine);
  EXPECT_EQ(events(*store, FlightEventKind::segments_merged).size(), 1U) << "once";
}

TEST(SharedGround, AnotherLandIsNotTakenForIt) {
  const TemporaryFolder temporary;
  const auto store = crossing_flight(temporary / "flight", passing_moments());
  FlightEngine engine(*store, crossing_setup(), kClockAtNow);
  engine.process();
  place_all(engine);
  const auto segments = store->segments();
  ASSERT_EQ(segments.size(), 3U);
  EXPECT_EQ(segments[2].state, SegmentState::floating);
  EXPECT_TRUE(events(*store, FlightEventKind::segments_merged).empty());
}

TEST(SharedGround, WhatAPersonTakesBackFloatsForEver) {
  const TemporaryFolder temporary;
  copy_flight("placed", temporary / "flight");
  {
    const auto store = FlightStore::open(temporary / "flight");
    ASSERT_TRUE(store->take_back_merge(2, "test", kNow));
    EXPECT_FALSE(store->placed_estimate(kSecondBegins + 2));
    EXPECT_EQ(store->segments()[2].state, SegmentState::floating);
  }
  const auto store = FlightStore::open(temporary / "flight");
  FlightEngine engine(*store, crossing_setup(), kClockAtNow);
  place_all(engine);
  EXPECT_EQ(store->segments()[2].state, SegmentState::floating);
}

// The first pass floats as well, and is placed in another way; the second one by the first. Without the first one's
// placement, the second one has none either, but may get another one.
TEST(SharedGround, FloatsAgainWhenWhatItWasPlacedByIsTakenBack) {
  const TemporaryFolder temporary;
  const auto store = crossing_flight(temporary / "flight", crossing_moments());
  FlightEngine engine(*store, blind_crossing_setup(), kClockAtNow);
  engine.process();
  ASSERT_EQ(store->segments().size(), 3U);
  place_all(engine);
  for (const FlightSegment& segment : store->segments()) ASSERT_EQ(segment.state, SegmentState::floating);
  const auto moments = crossing_moments();
  std::vector<EstimateRecord> placed;
  for (std::size_t i = 0; i < kFirstPass; ++i) {
    EstimateRecord& record = placed.emplace_back(i, store->estimates(EstimateKind::online, i, 1).front());
    record.estimate.position = place_of(moments[i].truth.position);
    record.estimate.covariance_m2 = 4 * Eigen::Matrix2d::Identity();
    record.estimate.sigma_m = 2;
    record.estimate.source = SourceLabel::vo_extrapolated;
    record.state.heading_rad = moments[i].truth.attitude.heading_rad;
    record.state.heading_sigma_rad = 0.01;
    record.state.agl_m = moments[i].truth.agl_m;
    record.state.agl_sigma_m = 1;
  }
  const StoredFlightEvent event{FlightEventKind::segments_merged, 0, R"({"segment": 0, "by": "map"})"};
  ASSERT_TRUE(store->merge_segment(store->segments()[0], placed, event, kNow));
  place_all(engine);
  ASSERT_EQ(store->segments()[2].state, SegmentState::merged);
  const auto merged = events(*store, FlightEventKind::segments_merged);
  ASSERT_EQ(merged.size(), 2U);
  EXPECT_EQ(body(merged[1])["by"], "ground");
  EXPECT_LT(largest_error_m(*store, EstimateKind::refined), 8);
  EXPECT_GT(store->placed_estimate(kSecondBegins)->state.agl_m, 90) << "with its height";
  ASSERT_TRUE(store->take_back_merge(0, "test", kNow));
  for (const FlightSegment& segment : store->segments()) EXPECT_EQ(segment.state, SegmentState::floating);
  EXPECT_TRUE(store->placed_estimates().empty());
  const auto withdrawn = events(*store, FlightEventKind::merge_withdrawn);
  ASSERT_EQ(withdrawn.size(), 2U);
  EXPECT_EQ(body(withdrawn[0])["by"], "test");
  EXPECT_EQ(body(withdrawn[1])["placed_by"], 0);
  EXPECT_TRUE(store->merge_taken_back(store->segments()[0]));
  EXPECT_FALSE(store->merge_taken_back(store->segments()[2]));
  place_all(engine);
  EXPECT_EQ(store->segments()[2].state, SegmentState::floating) << "nothing else shows its ground";
}

TEST(SharedGround, IsCancelled) {
  const TemporaryFolder temporary;
  const auto store = crossed_and_processed(temporary / "flight");
  FlightEngine engine(*store, crossing_setup(), kClockAtNow);
  int checks = 0;
  const Cancel late([&checks] { return ++checks > 40; });
  EXPECT_THROW(
      {
        while (engine.place_segments(Scope::all, 1000, late)) {
        }
      },
      Interrupted);
  place_all(engine);
  EXPECT_EQ(store->segments()[2].state, SegmentState::merged);
}

TEST(SharedGround, KilledAtEveryCommitItEndsWithTheSameFlight) {
  const TemporaryFolder temporary;
  const auto fly = [&](const std::string& folder, int fatal_commit) {
    return run_process({NADIR_KILLED_FLIGHT, (temporary / folder).string(), "cross", std::to_string(fatal_commit)})
        .code;
  };
  copy_flight("processed", temporary / "whole");
  ASSERT_EQ(fly("whole", 0), 0);
  copy_flight("begun", temporary / "killed");  // from the last but one frame: what is of interest comes after
  int kills = 0;
  for (int run = 0; run < 60; ++run) {
    if (fly("killed", run + 1) == 0) break;  // before and after each commit; what was reported is not reported again
    ++kills;
  }
  EXPECT_GE(kills, 6);
  const auto whole = FlightStore::open(temporary / "whole"), killed = FlightStore::open(temporary / "killed");
  ASSERT_EQ(killed->segments().size(), 3U);
  EXPECT_EQ(killed->segments()[2].state, SegmentState::merged);
  EXPECT_EQ(written_out(*killed), written_out(*whole));
}

}  // namespace
}  // namespace nadir
