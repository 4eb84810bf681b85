#include "service/saved_flight.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <thread>

#include "base/digest.hpp"
#include "base/error.hpp"
#include "base/files.hpp"
#include "geodesy/local_frame.hpp"
#include "service/service_machine.hpp"
#include "service/service_rules.hpp"
#include "support/manual_clock.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using test::TemporaryFolder;

SavedFlight some_flight() {
  return {.boot_id = "f4a1",
          .saved_monotonic_s = 1234.5,
          .saved_unix_us = 1'750'000'000'123'456,
          .state = ServiceState::normal,
          .estimate = SavedEstimate{.monotonic_s = 1234.25,
                                    .unix_us = 1'749'999'999'873'456,
                                    .place = {8.551234567890123, -47.376543210987654},
                                    .sigma_m = 6.25,
                                    .ground_speed_mps = 24.5,
                                    .source = SourceLabel::vo_extrapolated,
                                    .segment = 3,
                                    .velocity = SavedVelocity{-3.25, 24.1}},
          .hint = SavedHint{{8.5, -47.3}, 500}};
}

void expect_same(const SavedFlight& a, const SavedFlight& b) {
  EXPECT_EQ(a.boot_id, b.boot_id);
  EXPECT_EQ(a.saved_monotonic_s, b.saved_monotonic_s);
  EXPECT_EQ(a.saved_unix_us, b.saved_unix_us);
  EXPECT_EQ(a.state, b.state);
  ASSERT_EQ(a.estimate.has_value(), b.estimate.has_value());
  if (a.estimate) {
    EXPECT_EQ(a.estimate->monotonic_s, b.estimate->monotonic_s);
    EXPECT_EQ(a.estimate->unix_us, b.estimate->unix_us);
    EXPECT_EQ(a.estimate->place, b.estimate->place) << "to the last bit";
    EXPECT_EQ(a.estimate->sigma_m, b.estimate->sigma_m);
    EXPECT_EQ(a.estimate->ground_speed_mps, b.estimate->ground_speed_mps);
    EXPECT_EQ(a.estimate->source, b.estimate->source);
    EXPECT_EQ(a.estimate->segment, b.estimate->segment);
    ASSERT_EQ(a.estimate->velocity.has_value(), b.estimate->velocity.has_value());
    if (a.estimate->velocity) {
      EXPECT_EQ(a.estimate->velocity->east_mps, b.estimate->velocity->east_mps);
      EXPECT_EQ(a.estimate->velocity->north_mps, b.estimate->velocity->north_mps);
    }
  }
  ASSERT_EQ(a.hint.has_value(), b.hint.has_value());
  if (a.hint) {
    EXPECT_EQ(a.hint->place, b.hint->place);
    EXPECT_EQ(a.hint->radius_m, b.hint->radius_m);
  }
}

std::string sealed(const std::string& line) { return line + "\n" + sha256(as_bytes(line)).hex() + "\n"; }

// The first event of a start: it must be clear to somebody who never saw the file.
TEST(StateDirectory, SaysWhatATornFlightMeans) {
  const TemporaryFolder folder;
  const StateDirectory state(folder / "state");
  state.prepare();
  ASSERT_EQ(state.save(some_flight()), std::nullopt);
  const std::filesystem::path file = folder / "state/flight.json";
  std::filesystem::resize_file(file, 20);
  EXPECT_EQ(state.load().rejection, "cold start, the saved flight cannot be used: cut short");
  std::filesystem::remove(file);
  std::filesystem::create_directory(file);
  EXPECT_EQ(state.load().rejection.rfind("cold start, the saved flight cannot be used: not a file", 0), 0U);
}

TEST(StateDirectory, LoadsWhatWasSaved) {
  const TemporaryFolder folder;
  const StateDirectory state(folder / "state");
  EXPECT_EQ(state.load().rejection, "no saved state: cold start");
  state.prepare();
  SavedFlight flight = some_flight();
  EXPECT_EQ(state.save(flight), std::nullopt);
  expect_same(*StateDirectory(folder / "state").load().flight, flight);
  flight.estimate->velocity.reset();
  EXPECT_EQ(state.save(flight), std::nullopt);
  expect_same(*state.load().flight, flight);
  flight.estimate.reset();
  flight.hint.reset();
  flight.state = ServiceState::failsafe;
  EXPECT_EQ(state.save(flight), std::nullopt);
  expect_same(*state.load().flight, flight);
}

TEST(StateDirectory, RemovesTemporaryFilesOfAKilledWriter) {
  const TemporaryFolder folder;
  folder.write(".flight.json.00000000deadbeef.tmp", "half a fli");
  folder.write("signing.json", "not ours");
  StateDirectory(folder.path()).prepare();
  EXPECT_FALSE(std::filesystem::exists(folder / ".flight.json.00000000deadbeef.tmp"));
  EXPECT_TRUE(std::filesystem::exists(folder / "signing.json"));
}

// The service starts without it, and tries again.
TEST(StateDirectory, WhatIsNotAFolderCannotBePreparedAndIsReadAsEmpty) {
  const TemporaryFolder folder;
  folder.write("file", "");
  for (const char* name : {"file", "file/under"}) {
    const StateDirectory state(folder / name);
    EXPECT_THROW(state.prepare(), Error);
    EXPECT_FALSE(state.load().flight);
    EXPECT_FALSE(state.load_acceptance().record);
    EXPECT_TRUE(state.save(some_flight()));
  }
  std::filesystem::remove(folder / "file");
  const StateDirectory state(folder / "file");
  state.prepare();
  EXPECT_FALSE(state.save(some_flight())) << "now there is room for it";
}

TEST(StateDirectory, AFailedSaveKeepsTheLastFileAndReportsWhy) {
  const TemporaryFolder folder;
  const StateDirectory state(folder / "state");
  state.prepare();
  ASSERT_EQ(state.save(some_flight()), std::nullopt);
  SavedFlight impossible = some_flight();
  impossible.estimate->sigma_m = std::nan("");
  EXPECT_TRUE(state.save(impossible));
  expect_same(*state.load().flight, some_flight());
  std::filesystem::remove_all(folder / "state");
  const auto problem = state.save(some_flight());
  ASSERT_TRUE(problem);
  EXPECT_NE(problem->find("flight.json"), std::string::npos) << *problem;
}

TEST(StateDirectory, AFolderInPlaceOfTheFileIsRejected) {
  const TemporaryFolder folder;
  const StateDirectory state(folder.path());
  std::filesystem::create_directory(folder / "flight.json");
  EXPECT_FALSE(state.load().flight);
}

TEST(SavedFlight, EveryTruncationIsRejected) {
  const std::string text = to_text(some_flight());
  for (std::size_t size = 0; size < text.size(); ++size) {
    const SavedFlightReading reading = parse_saved_flight(text.substr(0, size));
    ASSERT_FALSE(reading.flight) << size;
    ASSERT_FALSE(reading.rejection.empty()) << size;
  }
  EXPECT_FALSE(parse_saved_flight(text + "x").flight);
}

TEST(SavedFlight, EveryFlippedBitIsRejected) {
  const std::string text = to_text(some_flight());
  for (std::size_t i = 0; i < text.size(); ++i) {
    for (const int bit : {0, 3, 6}) {
      std::string damaged = text;
      damaged[i] = static_cast<char>(damaged[i] ^ (1 << bit));
      ASSERT_FALSE(parse_saved_flight(damaged).flight) << i;
    }
  }
}

TEST(SavedFlight, GarbageIsRejected) {
  for (const std::string& text : {std::string("\n"), std::string(60'000, '['), std::string(100, '\0'), sealed(""),
                                  sealed("null"), sealed("[]"), sealed("{}"), sealed("\xff\xfe")}) {
    EXPECT_FALSE(parse_saved_flight(text).flight);
  }
}

// Rightly sealed and still wrong: nobody but us writes such a file, but nothing of it may be used.
TEST(SavedFlight, WrongValuesAreRejectedByName) {
  const std::string good = to_text(some_flight());
  const std::string line = good.substr(0, good.find('\n'));
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string changed = line;
    const std::size_t at = changed.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    changed.replace(at, from.size(), to);
    return parse_saved_flight(sealed(changed));
  };
  EXPECT_TRUE(parse_saved_flight(sealed(line)).flight);
  EXPECT_NE(with("\"sigma_m\":6.25", "\"sigma_m\":-1").rejection.find("sigma_m"), std::string::npos);
  EXPECT_NE(with("\"sigma_m\":6.25", "\"sigma_m\":\"6\"").rejection.find("sigma_m"), std::string::npos);
  EXPECT_NE(with("\"sigma_m\":6.25", "\"sigma\":6.25").rejection.find("sigma_m"), std::string::npos);
  EXPECT_NE(with("\"lat_deg\":-47.376", "\"lat_deg\":-97.376").rejection.find("lat_deg"), std::string::npos);
  EXPECT_NE(with("vo_extrapolated", "divined").rejection.find("source"), std::string::npos);
  EXPECT_NE(with("\"normal\"", "\"abnormal\"").rejection.find("state"), std::string::npos);
  EXPECT_NE(with("nadir.flight/1", "nadir.flight/2").rejection.find("schema"), std::string::npos);
  EXPECT_NE(with("\"segment\":3", "\"segment\":-3").rejection.find("segment"), std::string::npos);
  EXPECT_NE(with("\"segment\":3", "\"segment\":3e9").rejection.find("segment"), std::string::npos);
  EXPECT_NE(with("\"ground_speed_m_s\":24.5", "\"ground_speed_m_s\":1e300").rejection.find("speed"), std::string::npos);
  EXPECT_FALSE(with("\"boot_id\":\"f4a1\"", "\"boot_id\":7").flight);
  EXPECT_FALSE(with("\"segment\":3", "\"segment\":3,\"segment\":4").flight);
}

// A reader at any moment sees a whole state: the old or the new one.
TEST(StateDirectory, AReaderNeverSeesAPartialFile) {
  const TemporaryFolder folder;
  const StateDirectory state(folder.path());
  ASSERT_EQ(state.save(some_flight()), std::nullopt);
  std::jthread writer([&] {
    for (int i = 0; i < 50; ++i) {
      SavedFlight flight = some_flight();
      flight.boot_id = std::string(static_cast<std::size_t>(1 + i * 37 % 400), 'b');
      state.save(flight);
    }
  });
  for (int i = 0; i < 300; ++i) ASSERT_TRUE(state.load().flight);
}

SavedFlight saved_at(const FlightClock& clock) {
  return {.boot_id = clock.boot_id(),
          .saved_monotonic_s = clock.monotonic_s(),
          .saved_unix_us = clock.unix_us(),
          .state = ServiceState::normal,
          .estimate = SavedEstimate{.monotonic_s = clock.monotonic_s(),
                                    .unix_us = clock.unix_us(),
                                    .place = {8.5, 47.3},
                                    .sigma_m = 10,
                                    .ground_speed_mps = 25,
                                    .source = SourceLabel::vo_extrapolated,
                                    .segment = 2},
          .hint = SavedHint{{8.4, 47.2}, 300}};
}

Restart after(const SavedFlight& flight, const FlightClock& clock) { return restart_from({flight, {}}, clock); }

TEST(Restart, SigmaGrowsByAgeTimesSpeed) {
  ManualClock clock;
  const SavedFlight flight = saved_at(clock);
  clock.advance(4);
  const Restart restart = after(flight, clock);
  ASSERT_TRUE(restart.position);
  EXPECT_EQ(restart.position->place, (LonLat{8.5, 47.3}));
  EXPECT_NEAR(restart.position->age_s, 4, 1e-9);
  EXPECT_NEAR(restart.position->sigma_m, 10 + 4 * 25, 1e-6);
  EXPECT_EQ(restart.position->speed_mps, 25);
  EXPECT_EQ(restart.position->segment, 2);
  ASSERT_TRUE(restart.hint);
}

TEST(Restart, ForSomeSecondsThePositionIsPropagated) {
  ManualClock clock;
  SavedFlight flight = saved_at(clock);
  flight.estimate->velocity = SavedVelocity{15, -20};
  clock.advance(2);
  const Restart soon = after(flight, clock);
  const PlanePoint way = LocalFrame({8.5, 47.3}).plane_from_lonlat(soon.position->place);
  EXPECT_NEAR(way.east_m, 30, 1e-3);
  EXPECT_NEAR(way.north_m, -40, 1e-3);
  EXPECT_NEAR(soon.position->sigma_m, 10 + std::sqrt(5.0 * 5 + 2 * 2 + 12.5 * 12.5), 1e-6);
  EXPECT_EQ(soon.position->speed_mps, 25);
  clock.advance(30);
  const Restart late = after(flight, clock);
  EXPECT_EQ(late.position->place, (LonLat{8.5, 47.3})) << "who knows where it turned";
  EXPECT_NEAR(late.position->sigma_m, 10 + 32 * 25, 1e-6);
}

TEST(Restart, TheSpeedHasAMinimum) {
  ManualClock clock;
  SavedFlight flight = saved_at(clock);
  flight.estimate->ground_speed_mps = 0;
  clock.advance(4);
  EXPECT_NEAR(after(flight, clock).position->sigma_m, 10 + 4 * 15, 1e-6);
}

TEST(Restart, StepsOfUtcDoNotMatterWithinOneBoot) {
  for (const double step_s : {-86400.0 * 365, -10.0, 10.0, 86400.0 * 365}) {
    ManualClock clock;
    const SavedFlight flight = saved_at(clock);
    clock.step_utc(step_s);
    clock.advance(2);
    ASSERT_TRUE(after(flight, clock).position) << step_s;
    EXPECT_NEAR(after(flight, clock).position->age_s, 2, 1e-9);
  }
}

TEST(Restart, FromTheFutureIsRejected) {
  ManualClock clock(1000);
  const SavedFlight flight = saved_at(clock);
  const ManualClock earlier(999);
  EXPECT_FALSE(after(flight, earlier).position);
  EXPECT_FALSE(after(flight, earlier).hint);
  EXPECT_NE(after(flight, earlier).reason.find("future"), std::string::npos);
  const ManualClock reset(5, 1'000'000, "boot-2");  // rebooted, and the time of day is lost
  EXPECT_FALSE(after(flight, reset).position);
}

TEST(Restart, APositionNewerThanItsFileIsRejected) {
  ManualClock clock;
  SavedFlight flight = saved_at(clock);
  flight.estimate->monotonic_s += 0.5;
  clock.advance(2);
  EXPECT_FALSE(after(flight, clock).position);
}

TEST(Restart, AnotherFlightIsRejected) {
  ManualClock clock;
  const SavedFlight flight = saved_at(clock);
  clock.advance(1799);
  EXPECT_TRUE(after(flight, clock).position);
  clock.advance(2);
  EXPECT_FALSE(after(flight, clock).position);
  EXPECT_FALSE(after(flight, clock).hint);
  EXPECT_NE(after(flight, clock).reason.find("another flight"), std::string::npos);
}

TEST(Restart, AfterARebootTheAgeIsNeverUnderestimated) {
  const ManualClock before(5000, 1'750'000'000'000'000, "boot-1");
  const SavedFlight flight = saved_at(before);
  const ManualClock rebooted(30, 1'750'000'000'000'000 + 40'000'000, "boot-2");
  EXPECT_NEAR(after(flight, rebooted).position->age_s, 40 + 60, 1e-9);
  const ManualClock stale_clock(30, 1'750'000'000'000'000 + 1'000'000,
                                "boot-2");  // the clock went on from a saved time
  EXPECT_NEAR(after(flight, stale_clock).position->age_s, 30 + 60, 1e-9);
  const ManualClock unknown(500, 1'750'000'000'000'000 + 1'000'000, "");
  SavedFlight nameless = flight;
  nameless.boot_id.clear();
  EXPECT_NEAR(after(nameless, unknown).position->age_s, 500 + 60, 1e-6) << "two unknown boots are not the same boot";
}

TEST(Restart, WithoutAPositionTheHintRemains) {
  ManualClock clock;
  SavedFlight flight = saved_at(clock);
  flight.estimate->source = SourceLabel::no_fix;
  EXPECT_FALSE(after(flight, clock).position);
  EXPECT_TRUE(after(flight, clock).hint);
  flight.estimate.reset();
  EXPECT_FALSE(after(flight, clock).position);
}

TEST(Restart, WithoutASavedFlightThereIsNoRestart) {
  const ManualClock clock;
  const Restart restart = restart_from({std::nullopt, "truncated"}, clock);
  EXPECT_FALSE(restart.position);
  EXPECT_EQ(restart.reason, "truncated");
}

// Killed in flight, started again two seconds later: a position within five seconds, with its true age.
TEST(Restart, InFlightThereIsAPositionWithinFiveSeconds) {
  const test::TemporaryFolder folder;
  ManualClock clock;
  ASSERT_EQ(StateDirectory(folder.path()).save(saved_at(clock)), std::nullopt);
  clock.step_utc(-7200);  // and somebody set the clock
  clock.advance(2);
  const double killed_s = clock.monotonic_s() - 2;

  ServiceMachine machine(clock.monotonic_s());
  const Restart restart = restart_from(StateDirectory(folder.path()).load(), clock);
  ASSERT_TRUE(restart.position);
  machine.on_event(clock.monotonic_s(), EstimateRestored{restart.position->sigma_m, restart.position->speed_mps});
  clock.advance(1.5);
  machine.on_event(clock.monotonic_s(), PackageVerified{true});
  clock.advance(1);
  machine.on_event(clock.monotonic_s(), AutopilotHeartbeat{LinkAuthentication::signature, true});
  EXPECT_TRUE(machine.status().fix);
  EXPECT_LE(clock.monotonic_s() - killed_s, 5);
  EXPECT_NEAR(machine.status().sigma_m, 10 + 4.5 * 25, 1e-6);
  EXPECT_EQ(machine.status().source, SourceLabel::dead_reckoned);
}

// A reboot in the air, and the clock is wrong afterwards: the flight is the same, the age is that since the boot.
TEST(RestartOfTheSameFlight, AWrongClockAfterARebootCostsNoPosition) {
  const SavedFlight flight = saved_at(ManualClock());
  constexpr std::int64_t kSaved_us = 1'750'000'000'000'000;
  for (const double wrong_s : {-1.7e9, -600.0, -10.0, 2 * 365 * 86'400.0}) {
    const ManualClock rebooted(20, kSaved_us + static_cast<std::int64_t>(wrong_s * 1e6), "boot-2");
    EXPECT_FALSE(restart_from({flight, {}}, rebooted, false).position) << wrong_s;
    const Restart restart = restart_from({flight, {}}, rebooted, true);
    ASSERT_TRUE(restart.position) << wrong_s << ": " << restart.reason;
    EXPECT_NEAR(restart.position->age_s, 20 + kRebootAllowance_s, 1) << wrong_s;
    EXPECT_GT(restart.position->sigma_m, 500) << "where the search begins, no fix";
  }
  const ManualClock right(20, kSaved_us + 90'000'000, "boot-2");
  EXPECT_EQ(restart_from({flight, {}}, right, true).position->age_s,
            restart_from({flight, {}}, right, false).position->age_s)
      << "a clock that makes sense is used";
}

}  // namespace
}  // namespace nadir
