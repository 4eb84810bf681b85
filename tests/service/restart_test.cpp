#include "service/saved_flight.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "geodesy/local_frame.hpp"
#include "support/manual_clock.hpp"
#include "service/service_machine.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

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

TEST(Restart, ForSomeSecondsTheAircraftFlewOnAsItDid) {
  ManualClock clock;
  SavedFlight flight = saved_at(clock);
  flight.estimate->velocity = SavedVelocity{15, -20};
  clock.advance(2);
  const Restart soon = after(flight, clock);
  const Enu way = LocalFrame({8.5, 47.3}).enu_from_lonlat(soon.position->place);
  EXPECT_NEAR(way.east_m, 30, 1e-3);
  EXPECT_NEAR(way.north_m, -40, 1e-3);
  EXPECT_NEAR(soon.position->sigma_m, 10 + std::sqrt(5.0 * 5 + 2 * 2 + 12.5 * 12.5), 1e-6);
  EXPECT_EQ(soon.position->speed_mps, 25);
  clock.advance(30);
  const Restart late = after(flight, clock);
  EXPECT_EQ(late.position->place, (LonLat{8.5, 47.3})) << "who knows where it turned";
  EXPECT_NEAR(late.position->sigma_m, 10 + 32 * 25, 1e-6);
}

TEST(Restart, AnAircraftNeverStandsStill) {
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

TEST(Restart, FromTheFutureIsRefused) {
  ManualClock clock(1000);
  const SavedFlight flight = saved_at(clock);
  const ManualClock earlier(999);
  EXPECT_FALSE(after(flight, earlier).position);
  EXPECT_FALSE(after(flight, earlier).hint);
  EXPECT_NE(after(flight, earlier).reason.find("future"), std::string::npos);
  const ManualClock reset(5, 1'000'000, "boot-2");  // rebooted, and the time of day is lost
  EXPECT_FALSE(after(flight, reset).position);
}

TEST(Restart, APositionFromAfterItsFileIsRefused) {
  ManualClock clock;
  SavedFlight flight = saved_at(clock);
  flight.estimate->monotonic_s += 0.5;
  clock.advance(2);
  EXPECT_FALSE(after(flight, clock).position);
}

TEST(Restart, AnotherFlightIsRefused) {
  ManualClock clock;
  const SavedFlight flight = saved_at(clock);
  clock.advance(1799);
  EXPECT_TRUE(after(flight, clock).position);
  clock.advance(2);
  EXPECT_FALSE(after(flight, clock).position);
  EXPECT_FALSE(after(flight, clock).hint);
  EXPECT_NE(after(flight, clock).reason.find("another flight"), std::string::npos);
}

TEST(Restart, OverARebootTheAgeIsNeverTakenTooSmall) {
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

TEST(Restart, WithoutAPositionTheHintStays) {
  ManualClock clock;
  SavedFlight flight = saved_at(clock);
  flight.estimate->source = SourceLabel::no_fix;
  EXPECT_FALSE(after(flight, clock).position);
  EXPECT_TRUE(after(flight, clock).hint);
  flight.estimate.reset();
  EXPECT_FALSE(after(flight, clock).position);
}

TEST(Restart, NothingSavedIsNothing) {
  const ManualClock clock;
  const Restart restart = restart_from({std::nullopt, "cut off"}, clock);
  EXPECT_FALSE(restart.position);
  EXPECT_EQ(restart.reason, "cut off");
}

// Killed in flight, started again two seconds later: a position within five seconds, honest about its age.
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
  machine.update(clock.monotonic_s(), EstimateRestored{restart.position->sigma_m, restart.position->speed_mps});
  clock.advance(1.5);
  machine.update(clock.monotonic_s(), PackageVerified{true});
  clock.advance(1);
  machine.update(clock.monotonic_s(), AutopilotHeartbeat{true, true});
  EXPECT_TRUE(machine.status().fix);
  EXPECT_LE(clock.monotonic_s() - killed_s, 5);
  EXPECT_NEAR(machine.status().sigma_m, 10 + 4.5 * 25, 1e-6);
  EXPECT_EQ(machine.status().source, SourceLabel::dead_reckoned);
}

}  // namespace
}  // namespace nadir
