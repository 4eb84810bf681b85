#include "service/acceptance_record.hpp"

#include <gtest/gtest.h>

#include "base/files.hpp"
#include "service/saved_flight.hpp"
#include "service/service_rules.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

AcceptedPackage some_package(std::int64_t sequence) {
  return {.manifest = sha256(as_bytes("manifest " + std::to_string(sequence))),
          .folder = "/data/packages/" + std::to_string(sequence),
          .series = "valley",
          .sequence = sequence,
          .accepted_at = {1'750'000'000},
          .airframe_file = "{\"format\": \"nadir.airframe/1\"}\n"};
}

TEST(AcceptanceRecord, IsReadAsItWasWritten) {
  AcceptanceRecord record = accepted_next(std::nullopt, some_package(1), "boot-1");
  EXPECT_EQ(parse_acceptance(to_text(record)).record, record);
  record = accepted_next(record, some_package(2), "boot-2");
  EXPECT_EQ(record.previous, some_package(1));
  record.airborne = true;
  EXPECT_EQ(parse_acceptance(to_text(record)).record, record);
  EXPECT_EQ(accepted_next(record, some_package(2), "boot-3").previous, some_package(1)) << "the same one again";
}

TEST(AcceptanceRecord, HoldsInOneBootAndOverAllOnceArmed) {
  AcceptanceRecord record = accepted_next(std::nullopt, some_package(1), "boot-1");
  EXPECT_TRUE(record.holds("boot-1"));
  EXPECT_FALSE(record.holds("boot-2"));
  record.airborne = true;
  EXPECT_TRUE(record.holds("boot-2"));
  EXPECT_TRUE(record.holds(""));
  record.airborne = false;
  record.boot_id.clear();  // landed
  EXPECT_FALSE(record.holds("boot-1"));
  EXPECT_FALSE(record.holds("")) << "an unknown boot is none";
}

TEST(AcceptanceRecord, TornAtEveryByteIsRejected) {
  const std::string text = to_text(accepted_next(std::nullopt, some_package(1), "boot-1"));
  for (std::size_t size = 0; size < text.size(); ++size) {
    const AcceptanceReading reading = parse_acceptance(text.substr(0, size));
    ASSERT_FALSE(reading.record) << size;
    ASSERT_FALSE(reading.rejection.empty()) << size;
  }
  for (std::size_t at = 0; at < text.size(); ++at) {
    std::string flipped = text;
    flipped[at] = static_cast<char>(flipped[at] ^ 1);
    ASSERT_FALSE(parse_acceptance(flipped).record) << at;
  }
}

TEST(AcceptanceRecord, TheStateDirectoryKeepsItAndALinkOrFolderInItsPlaceIsNoRecord) {
  const test::TemporaryFolder folder;
  const StateDirectory state(folder / "state");
  EXPECT_FALSE(state.load_acceptance().record);
  EXPECT_EQ(state.load_acceptance().rejection, "") << "nothing was accepted yet";
  const AcceptanceRecord record = accepted_next(std::nullopt, some_package(1), "boot-1");
  EXPECT_THROW(state.save(record), std::exception) << "no folder yet";
  state.prepare();
  state.save(record);
  EXPECT_EQ(state.load_acceptance().record, record);
  std::filesystem::remove(folder / "state/acceptance.json");
  std::filesystem::create_directory(folder / "state/acceptance.json");
  EXPECT_FALSE(state.load_acceptance().record);
  EXPECT_NE(state.load_acceptance().rejection, "");
}

TEST(FlightPhase, ArmedIsAirborneAndOnlySteadyDisarmingIsALanding) {
  FlightPhase phase(false);
  EXPECT_EQ(phase.on_heartbeat(0, false), FlightPhase::Change::none);
  EXPECT_EQ(phase.on_heartbeat(100, false), FlightPhase::Change::none) << "it never flew";
  EXPECT_EQ(phase.on_heartbeat(101, true), FlightPhase::Change::took_off);
  EXPECT_EQ(phase.on_heartbeat(102, true), FlightPhase::Change::none);
  EXPECT_EQ(phase.on_heartbeat(103, false), FlightPhase::Change::none);
  EXPECT_EQ(phase.on_heartbeat(103 + kLanded_s - 0.1, false), FlightPhase::Change::none);
  EXPECT_EQ(phase.on_heartbeat(114, true), FlightPhase::Change::none) << "armed again: the time counts anew";
  EXPECT_EQ(phase.on_heartbeat(115, false), FlightPhase::Change::none);
  EXPECT_EQ(phase.on_heartbeat(115 + kLanded_s, false), FlightPhase::Change::landed);
  EXPECT_FALSE(phase.airborne());
  EXPECT_TRUE(phase.armed_ever());
}

TEST(FlightPhase, AfterARestartInFlightSilenceIsNoLanding) {
  FlightPhase phase(true);
  EXPECT_TRUE(phase.airborne());
  EXPECT_FALSE(phase.armed_ever());
  EXPECT_EQ(phase.on_heartbeat(5000, true), FlightPhase::Change::none);
  EXPECT_TRUE(phase.airborne());
  FlightPhase parked(true);  // the battery was taken out before anybody disarmed
  EXPECT_EQ(parked.on_heartbeat(10, false), FlightPhase::Change::none);
  EXPECT_EQ(parked.on_heartbeat(10 + kLanded_s, false), FlightPhase::Change::landed);
  EXPECT_FALSE(parked.armed_ever());
}

}  // namespace
}  // namespace nadir
