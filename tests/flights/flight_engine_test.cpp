// A stored flight: processed, interrupted at every point, and gone on with.
#include "flights/flight_engine.hpp"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/random.hpp"
#include "flights/stored_flight.hpp"
#include "imagery/sqlite_database.hpp"
#include "recorder/record_codec.hpp"
#include "support/cancel_after.hpp"
#include "support/process.hpp"
#include "support/small_disk.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using namespace test;
namespace fs = std::filesystem;

const FlightEngineOptions kOptions{.clock = [] { return kNow; }, .keep_looks = true};

void process_wholly(FlightStore& store, Course course) {
  FlightEngine engine(store, engine_setup(course), kOptions);
  engine.process();
  engine.complete();
}

// A flight that nothing interrupts; to be read only.
struct WholeFlight {
  explicit WholeFlight(Course course) : store(stored_flight(folder / "flight", course)) {
    process_wholly(*store, course);
    text = written_out(*store);
  }
  const TemporaryFolder folder;
  const std::unique_ptr<FlightStore> store;
  std::string text;
};

const WholeFlight& whole_flight(Course course) {
  static std::map<Course, WholeFlight> flights;
  return flights.try_emplace(course, course).first->second;
}

const std::string& uninterrupted(Course course) { return whole_flight(course).text; }

std::vector<FlightEventKind> kinds(const FlightStore& store) {
  std::vector<FlightEventKind> kinds;
  for (const EventRow& row : store.events_after(0, 10'000)) {
    if (row.event.kind != FlightEventKind::frame_processed) kinds.push_back(row.event.kind);
  }
  return kinds;
}

TEST(FlightEngine, GivesTheEstimatesOfTheLocalizer) {
  const auto store = FlightStore::in_memory(description(Course::smooth), kNow);
  const TemporaryFolder temporary;
  const auto& pictures = flight_pictures(Course::smooth);
  std::vector<Telemetry> rows;
  for (const EncodedPicture& picture : pictures) {
    write_file_atomic(temporary / picture.name, picture.bytes);
    rows.push_back(picture.telemetry);
  }
  store->refer(temporary.path(), rows, {}, kNow);
  FlightEngine engine(*store, engine_setup(Course::smooth), kOptions);
  std::vector<std::size_t> heard;
  EXPECT_EQ(engine.process({},
                           [&](std::size_t frame, FrameReport& report, bool restored) {
                             EXPECT_FALSE(restored);
                             EXPECT_FALSE(report.anchor.rectified.empty());
                             heard.push_back(frame);
                           }),
            pictures.size());
  EXPECT_EQ(heard, (std::vector<std::size_t>{0, 1, 2, 3, 4}));
  engine.complete();

  const FlightEngineSetup setup = engine_setup(Course::smooth);
  Localizer localizer(setup.camera, setup.frame, setup.tiles, setup.start, setup.localizer);
  const auto bits = [](Estimate estimate) {
    estimate.latency_ms = 0;
    return encode(Record(EstimateRecord{0, estimate, {}, {}}));
  };
  const auto online = store->estimates(EstimateKind::online), refined = store->estimates(EstimateKind::refined);
  const auto moments = flight(5);
  for (std::size_t i = 0; i < moments.size(); ++i) {
    Telemetry telemetry = moments[i].telemetry;
    telemetry.frame = pictures[i].name;
    EXPECT_EQ(bits(localizer.process(moments[i].image, telemetry).estimate), bits(online[i])) << i;
    EXPECT_GT(online[i].latency_ms, 0);
    EXPECT_LT(off_m(online[i], moments[i]), 4);
  }
  for (std::size_t i = 0; i < moments.size(); ++i) EXPECT_EQ(bits(localizer.refined()[i]), bits(refined[i])) << i;
}

TEST(FlightEngine, GoesOnAfterEachFrameWithTheSameEstimates) {
  for (const Course course : {Course::smooth, Course::rolling, Course::eventful}) {
    SCOPED_TRACE(static_cast<int>(course));
    const TemporaryFolder temporary;
    const auto store = stored_flight(temporary / "flight", course);
    const std::size_t frames = store->accepted();
    for (std::size_t i = 0; i < frames; ++i) {
      FlightEngine engine(*store, engine_setup(course), kOptions);
      std::size_t restored = 0;
      struct Enough {};
      EXPECT_THROW(engine.process({},
                                  [&](std::size_t frame, FrameReport&, bool again) {
                                    if (again) {
                                      EXPECT_EQ(frame, restored++);
                                    } else {
                                      throw Enough();
                                    }
                                  }),
                   Enough);
      EXPECT_EQ(restored, i);
      EXPECT_EQ(store->processed(), i + 1);
    }
    FlightEngine last(*store, engine_setup(course), kOptions);
    EXPECT_EQ(last.process(), 0U);
    last.complete();
    EXPECT_EQ(written_out(*store), uninterrupted(course));
  }
}

// The n-th commit, before and after: between the pictures of an eventful flight everything is lost once.
TEST(FlightEngine, KilledAtEveryCommitItGoesOnWithTheSameBytes) {
  const TemporaryFolder temporary;
  const fs::path folder = temporary / "flight";
  stored_flight(folder, Course::eventful).reset();
  const std::string original = written_out(*FlightStore::open(folder));
  int kills = 0;
  // The first commit of a run is that of the frame that the last run was killed at: it gets one frame further each
  // second time.
  for (int run = 0; run < 100; ++run) {
    const ProcessResult result =
        run_process({NADIR_KILLED_FLIGHT, folder.string(), "fly", "eventful", run % 2 == 0 ? "1" : "2"});
    if (result.code == 0) break;
    ASSERT_EQ(result.code, 128 + SIGKILL) << result.err;
    ++kills;
  }
  EXPECT_GE(kills, 10);
  // A kill before the commit and one after it alternate, so the last run may have been killed within complete().
  run_process({NADIR_KILLED_FLIGHT, folder.string(), "fly", "eventful", "0"});
  const auto store = FlightStore::open(folder);
  std::string found = written_out(*store), expected = uninterrupted(Course::eventful);
  // The flight may have been completed more than once; all else happened once.
  const auto without_completions = [](const std::string& text) {
    std::string kept;
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line);) {
      if (line.find("flight_completed") == std::string::npos) kept += line + '\n';
    }
    return kept;
  };
  EXPECT_EQ(without_completions(found), without_completions(expected));
  EXPECT_NE(found, original);
}

// At any moment, not only at commits. A flight that is complete before it is killed often enough makes way for another.
TEST(FlightEngine, KilledAtRandomMomentsItGoesOnWithTheSameEstimates) {
  static constexpr int kKills = 8, kMostRuns = 100;
  const TemporaryFolder temporary;
  const auto without_events = [](const std::string& text) { return text.substr(0, text.find("event")); };
  const std::string expected = without_events(uninterrupted(Course::eventful));
  Random random(23);
  fs::path folder;
  int kills = 0;
  for (int run = 0; run < kMostRuns && kills < kKills; ++run) {
    if (folder.empty()) {
      folder = temporary / std::to_string(run);
      stored_flight(folder, Course::eventful).reset();
    }
    const std::string program = NADIR_KILLED_FLIGHT, where = folder.string();
    const pid_t child = ::fork();
    if (child == 0) {
      ::execl(program.c_str(), program.c_str(), where.c_str(), "fly", "eventful", "0", nullptr);
      ::_exit(4);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(random.integer(20, 400)));
    ::kill(child, SIGKILL);
    int status = 0;
    ::waitpid(child, &status, 0);
    const auto store = FlightStore::open(folder);
    ASSERT_EQ(store->accepted(), 10U);
    if (WIFSIGNALED(status)) {
      ++kills;
    } else {
      ASSERT_EQ(status, 0);
      EXPECT_EQ(without_events(written_out(*store)), expected);
      folder.clear();
    }
  }
  EXPECT_EQ(kills, kKills);
  ASSERT_FALSE(folder.empty()) << "the last run was killed";
  const auto store = FlightStore::open(folder);
  process_wholly(*store, Course::eventful);
  EXPECT_EQ(without_events(written_out(*store)), expected);
}

TEST(FlightEngine, CancelledInAFrameItIsAsIfTheFrameHadNotBegun) {
  const TemporaryFolder temporary;
  const auto store = stored_flight(temporary / "flight", Course::smooth);
  FlightEngine engine(*store, engine_setup(Course::smooth), kOptions);
  for (int asked = 2; asked < 40; asked += 9) {
    CancelAfter canceller(asked);
    EXPECT_THROW(engine.process(canceller.cancel()), Interrupted);
  }
  engine.process();
  engine.complete();
  EXPECT_EQ(written_out(*store), uninterrupted(Course::smooth));
}

TEST(FlightEngine, PicturesMayComeWhileOthersAreProcessed) {
  const TemporaryFolder temporary;
  const auto& pictures = flight_pictures(Course::smooth);
  const auto store = FlightStore::create(temporary / "flight", description(Course::smooth), kNow);
  FlightEngine engine(*store, engine_setup(Course::smooth), kOptions);
  EXPECT_EQ(engine.process(), 0U);
  for (const EncodedPicture& picture : pictures) {
    const PictureOffer offer = picture.offer();
    store->accept({&offer, 1}, kNow);
    EXPECT_EQ(engine.process(), 1U);
  }
  engine.complete();
  const auto estimates = [](const std::string& text) { return text.substr(0, text.find("event")); };
  EXPECT_EQ(estimates(written_out(*store)), estimates(uninterrupted(Course::smooth)));
}

TEST(FlightEngine, ABatchIsStoredWhileFramesAreProcessed) {
  const TemporaryFolder temporary;
  const auto& pictures = flight_pictures(Course::smooth);
  const auto store = FlightStore::create(temporary / "flight", description(Course::smooth), kNow);
  const auto batch = offers(pictures);
  store->accept(std::span(batch).first(1), kNow);
  std::thread uploads([&] {
    for (std::size_t i = 1; i < batch.size(); ++i) {
      store->accept(std::span(batch).subspan(i, 1), kNow);
      store->events_after(0, 1000);
      store->segments();
    }
  });
  FlightEngine engine(*store, engine_setup(Course::smooth), kOptions);
  std::size_t processed = 0;
  while (processed < batch.size()) processed += engine.process();
  uploads.join();
  engine.complete();
  const auto estimates = [](const std::string& text) { return text.substr(0, text.find("event")); };
  EXPECT_EQ(estimates(written_out(*store)), estimates(uninterrupted(Course::smooth)));
}

TEST(FlightEngine, SegmentsAndEventsTellWhatHappened) {
  const auto& store = whole_flight(Course::smooth).store;
  using enum FlightEventKind;
  EXPECT_EQ(kinds(*store),
            (std::vector{flight_created, pictures_accepted, segment_started, segment_anchored, flight_completed}));
  ASSERT_EQ(store->segments().size(), 1U);
  EXPECT_EQ(store->segments()[0],
            (FlightSegment{
                .number = 0, .first_frame = 0, .last_frame = 4, .state = SegmentState::anchored, .anchored_frame = 0}));
  const auto events = store->events_after(0, 100);
  const auto body = nlohmann::json::parse(events.back().event.body);
  EXPECT_EQ(body, nlohmann::json::parse(R"({"frames":5,"placed":5,"anchored":5,"segments":1,"floating_segments":0})"));
  const auto processed = nlohmann::json::parse(events[3].event.body);
  EXPECT_EQ(events[3].event.kind, frame_processed);
  EXPECT_EQ(processed["verdict"], "accepted");
  EXPECT_EQ(processed["name"], "frame0.img");
  EXPECT_LT(processed["sigma_m"], 10);
}

TEST(FlightEngine, AnEventfulFlightHasSegments) {
  const auto& store = whole_flight(Course::eventful).store;
  const auto segments = store->segments();
  ASSERT_GE(segments.size(), 3U);
  for (std::size_t i = 0; i < segments.size(); ++i) {
    EXPECT_LE(segments[i].first_frame, segments[i].last_frame);
    EXPECT_EQ(segments[i].number, static_cast<int>(i)) << "numbers are given once, without gaps";
    EXPECT_EQ(segments[i].state == SegmentState::anchored, segments[i].anchored_frame.has_value());
  }
  // Frame 8 shows another place: a segment of its own, over which the one before it goes on.
  EXPECT_EQ(segments.back().first_frame, 8U);
  EXPECT_EQ(segments.back().last_frame, 8U);
  EXPECT_EQ(segments[segments.size() - 2].first_frame, 5U);
  EXPECT_EQ(segments[segments.size() - 2].last_frame, 9U);
}

TEST(FlightEngine, AFixIsAppliedAgainWhenTheFlightIsResumed) {
  const auto fly = [](const fs::path& folder, bool interrupt) {
    const auto store = FlightStore::create(folder, description(Course::eventful), kNow);
    const auto& pictures = flight_pictures(Course::eventful);
    const auto batch = offers(pictures);
    store->accept(std::span(batch).first(2), kNow);
    auto engine = std::make_unique<FlightEngine>(*store, engine_setup(Course::eventful), kOptions);
    engine->process();
    store->add_fix(place_of(flight(3)[2].truth.position), 40, "a person", kNow);
    store->accept(std::span(batch).subspan(2), kNow);
    if (interrupt) {
      struct Enough {};
      EXPECT_THROW(engine->process({},
                                   [](std::size_t frame, FrameReport&, bool) {
                                     if (frame == 4) throw Enough();
                                   }),
                   Enough);
      engine = std::make_unique<FlightEngine>(*store, engine_setup(Course::eventful), kOptions);
    }
    engine->process();
    engine->complete();
    return written_out(*store);
  };
  const TemporaryFolder temporary;
  EXPECT_EQ(fly(temporary / "one", false), fly(temporary / "other", true));
}

// One fix is withdrawn after frames were processed with it, another one before: resuming compares every bit.
TEST(FlightEngine, AFlightWithWithdrawnFixesIsResumed) {
  const TemporaryFolder temporary;
  const auto store = FlightStore::create(temporary / "flight", description(Course::eventful), kNow);
  const auto& pictures = flight_pictures(Course::eventful);
  const auto batch = offers(pictures);
  const auto processed_anew = [&] {
    FlightEngine engine(*store, engine_setup(Course::eventful), kOptions);
    return engine.process();
  };
  store->accept(std::span(batch).first(2), kNow);
  EXPECT_EQ(processed_anew(), 2U);
  const std::int64_t used = store->add_fix(place_of(flight(3)[2].truth.position), 40, "a person", kNow).id;
  store->accept(std::span(batch).subspan(2, 1), kNow);
  EXPECT_EQ(processed_anew(), 1U);
  store->withdraw_fix(used, kNow);
  store->withdraw_fix(store->add_fix({.lon_deg = 0, .lat_deg = 0}, 40, "a mistake", kNow).id, kNow);
  store->accept(std::span(batch).subspan(3), kNow);
  EXPECT_EQ(processed_anew(), batch.size() - 3) << "it would not resume if a fix were applied otherwise than it was";
}

TEST(FlightEngine, AMissingPictureBlocksTheFlightAndSaysSo) {
  const TemporaryFolder temporary;
  const auto store = stored_flight(temporary / "flight", Course::smooth);
  const fs::path picture = temporary / "flight" / "pictures" / "00000002.png", aside = temporary / "aside.png";
  fs::rename(picture, aside);
  FlightEngine engine(*store, engine_setup(Course::smooth), kOptions);
  EXPECT_THROW(engine.process(), Error);
  EXPECT_EQ(store->processed(), 2U);
  const EventRow last = store->events_after(0, 100).back();
  EXPECT_EQ(last.event.kind, FlightEventKind::processing_blocked);
  EXPECT_EQ(last.event.frame, 2U);
  fs::rename(aside, picture);
  EXPECT_EQ(engine.process(), 3U) << "it goes on";
}

TEST(FlightEngine, AFullDiskStopsItUntilThereIsRoom) {
  const TemporaryFolder temporary;
  SmallDisk disk(temporary / "disk", "size=8m");
  if (!disk.mounted()) GTEST_SKIP() << "only root may mount a tmpfs";
  const fs::path folder = temporary / "disk" / "flight", ballast = temporary / "disk" / "ballast";
  const auto store = stored_flight(folder, Course::smooth);
  FlightEngine engine(*store, engine_setup(Course::smooth), kOptions);
  const auto fill = [&](std::size_t frame, FrameReport&, bool) {
    if (frame == 1) temporary.write("disk/ballast", std::string(fs::space(folder).available, 'x'));
  };
  EXPECT_THROW(engine.process({}, fill), Error);
  EXPECT_EQ(store->processed(), 2U);
  EXPECT_THROW(engine.process(), Error) << "it is still full";
  fs::remove(ballast);
  EXPECT_EQ(engine.process(), 3U);
  engine.complete();
  const auto estimates = [](const std::string& text) { return text.substr(0, text.find("event")); };
  EXPECT_EQ(estimates(written_out(*store)), estimates(uninterrupted(Course::smooth)));
}

TEST(FlightEngine, ChangedRowsAreAnError) {
  for (const char* change :
       {"UPDATE measurement SET answers = x'0102' WHERE frame = 1", "DELETE FROM measurement WHERE frame = 1",
        "UPDATE estimate SET record = x'00' WHERE frame = 1", "UPDATE picture SET telemetry = x'07' WHERE frame = 1",
        "UPDATE measurement SET answers = (SELECT answers FROM measurement WHERE frame = 0) WHERE frame = 1",
        "UPDATE estimate SET record = (SELECT record FROM estimate WHERE frame = 0) WHERE frame = 1"}) {
    const TemporaryFolder temporary;
    const fs::path folder = temporary / "flight";
    {
      const auto store = stored_flight(folder, Course::smooth);
      FlightEngine engine(*store, engine_setup(Course::smooth), kOptions);
      struct Enough {};
      EXPECT_THROW(engine.process({},
                                  [](std::size_t frame, FrameReport&, bool) {
                                    if (frame == 1) throw Enough();
                                  }),
                   Enough);
    }
    {
      SqliteDatabase database = SqliteDatabase::open_writable(folder / kFlightFile);
      database.execute(change);
      database.close();
    }
    const auto store = FlightStore::open(folder);
    FlightEngine engine(*store, engine_setup(Course::smooth), kOptions);
    EXPECT_THROW(engine.process(), Error) << change;
    EXPECT_EQ(store->processed(), 2U) << change;
  }
}

TEST(FlightEngine, FramesWithGapsAreNoFlight) {
  const TemporaryFolder temporary;
  const fs::path folder = temporary / "flight";
  stored_flight(folder, Course::smooth).reset();
  {
    SqliteDatabase database = SqliteDatabase::open_writable(folder / kFlightFile);
    database.execute("DELETE FROM picture WHERE frame = 1");
    database.close();
  }
  EXPECT_THROW(FlightStore::open(folder), Error);
}

TEST(FlightEngine, AnotherMapOrStartIsNoticed) {
  const TemporaryFolder temporary;
  const auto store = stored_flight(temporary / "flight", Course::smooth);
  {
    FlightEngine engine(*store, engine_setup(Course::smooth), kOptions);
    struct Enough {};
    EXPECT_THROW(engine.process({}, [](std::size_t, FrameReport&, bool) { throw Enough(); }), Enough);
  }
  FlightEngineSetup other = engine_setup(Course::smooth);
  other.start = kOrigin;
  FlightEngine engine(*store, other, kOptions);
  EXPECT_THROW(engine.process(), Error);
  EXPECT_EQ(store->processed(), 1U);
}

// ---- The state machine of segments by itself

FrameReport report(int segment, AnchorVerdict verdict, double window_m = 60) {
  FrameReport report;
  report.estimate.segment = segment;
  report.anchor.verdict = verdict;
  report.anchor.window_radius_m = window_m;
  return report;
}

std::vector<FlightEventKind> kinds(const SegmentTracker::Changes& changes) {
  std::vector<FlightEventKind> kinds;
  for (const StoredFlightEvent& event : changes.events) {
    if (event.kind != FlightEventKind::frame_processed) kinds.push_back(event.kind);
  }
  return kinds;
}

TEST(SegmentTracker, AsksForHelpOnceAfterThreeFailures) {
  using enum FlightEventKind;
  SegmentTracker tracker;
  EXPECT_EQ(kinds(tracker.on_frame(report(0, AnchorVerdict::ambiguous, 60))), (std::vector{segment_started}));
  EXPECT_TRUE(kinds(tracker.on_frame(report(0, AnchorVerdict::not_tried, 60))).empty());
  EXPECT_TRUE(kinds(tracker.on_frame(report(0, AnchorVerdict::frame_unfit, 60))).empty());
  EXPECT_EQ(kinds(tracker.on_frame(report(0, AnchorVerdict::few_inliers, 120))), (std::vector{search_expanded}));
  EXPECT_EQ(kinds(tracker.on_frame(report(0, AnchorVerdict::ambiguous, 125))), (std::vector{user_input_needed}));
  EXPECT_TRUE(kinds(tracker.on_frame(report(0, AnchorVerdict::ambiguous, 126))).empty());
  EXPECT_EQ(kinds(tracker.on_frame(report(0, AnchorVerdict::accepted, 130))), (std::vector{segment_anchored}));
  EXPECT_TRUE(kinds(tracker.on_frame(report(0, AnchorVerdict::accepted, 60))).empty());
  for (int i = 0; i < 2; ++i) EXPECT_TRUE(kinds(tracker.on_frame(report(0, AnchorVerdict::no_map))).empty());
  EXPECT_EQ(kinds(tracker.on_frame(report(0, AnchorVerdict::no_map))), (std::vector{user_input_needed})) << "again";
  EXPECT_EQ(kinds(tracker.on_frame(report(3, AnchorVerdict::accepted))),
            (std::vector{segment_started, segment_anchored}));
}

TEST(SegmentTracker, NamesThePlacesThatLookMostLikeALostFrame) {
  const LocalFrame plane(kOrigin);
  SegmentTracker tracker(plane);
  FrameReport lost = report(0, AnchorVerdict::ambiguous, 60);
  for (int i = 0; i < 7; ++i) {
    MatchHypothesis place;
    place.pose.position = {10.0 * i, 5};
    place.pose.attitude.heading_rad = 0.1;
    place.score = 1.05 - 0.1 * i;
    lost.anchor.places.push_back(place);
  }
  tracker.on_frame(lost);
  tracker.on_frame(lost);
  const auto asked = tracker.on_frame(lost).events.back();
  ASSERT_EQ(asked.kind, FlightEventKind::user_input_needed);
  const auto candidates = nlohmann::json::parse(asked.body)["candidates"];
  ASSERT_EQ(candidates.size(), 5U);
  EXPECT_EQ(candidates[0]["likeness"], 1);
  EXPECT_NEAR(candidates[2]["likeness"], 0.85, 1e-9);
  EXPECT_NEAR(candidates[2]["heading_deg"], 5.7296, 1e-3);
  const PlanePoint at = plane.plane_from_lonlat({candidates[2]["lon_deg"], candidates[2]["lat_deg"]});
  EXPECT_LT(distance_m(at, {20, 5}), 1e-3);
}

TEST(SegmentTracker, ASegmentGoesOnAfterAnOutlier) {
  using enum FlightEventKind;
  SegmentTracker tracker;
  EXPECT_EQ(kinds(tracker.on_frame(report(0, AnchorVerdict::accepted))),
            (std::vector{segment_started, segment_anchored}));
  EXPECT_EQ(kinds(tracker.on_frame(report(1, AnchorVerdict::ambiguous))), (std::vector{segment_started}));
  const auto changes = tracker.on_frame(report(0, AnchorVerdict::accepted));
  EXPECT_TRUE(kinds(changes).empty());
  ASSERT_EQ(changes.segments.size(), 1U);
  EXPECT_EQ(changes.segments[0],
            (FlightSegment{
                .number = 0, .first_frame = 0, .last_frame = 2, .state = SegmentState::anchored, .anchored_frame = 0}));
}

TEST(SegmentTracker, AVoteThatIsAwaitedIsNoFailure) {
  SegmentTracker tracker;
  tracker.on_frame(report(0, AnchorVerdict::accepted));
  for (int i = 0; i < 9; ++i) EXPECT_TRUE(kinds(tracker.on_frame(report(0, AnchorVerdict::awaiting_votes))).empty());
}

}  // namespace
}  // namespace nadir
