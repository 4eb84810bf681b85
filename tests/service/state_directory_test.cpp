#include "service/saved_flight.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <thread>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/sha256.hpp"
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

TEST(StateDirectory, GivesBackWhatWasSaved) {
  const TemporaryFolder folder;
  const StateDirectory state(folder / "state");
  EXPECT_EQ(state.load().refusal, "nothing was saved");
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

TEST(StateDirectory, SweepsUpWhatAKilledWriterLeft) {
  const TemporaryFolder folder;
  folder.write("flight.json.tmp4711", "half a fli");
  folder.write("signing.json", "not ours");
  const StateDirectory state(folder.path());
  EXPECT_FALSE(std::filesystem::exists(folder / "flight.json.tmp4711"));
  EXPECT_TRUE(std::filesystem::exists(folder / "signing.json"));
}

TEST(StateDirectory, RefusesWhatIsNoFolder) {
  const TemporaryFolder folder;
  folder.write("file", "");
  EXPECT_THROW(StateDirectory(folder / "file"), Error);
  EXPECT_THROW(StateDirectory(folder / "file/under"), Error);
}

TEST(StateDirectory, AFailedSaveKeepsTheLastOneAndSaysWhy) {
  const TemporaryFolder folder;
  const StateDirectory state(folder / "state");
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

TEST(StateDirectory, TheFileThatIsAFolderIsRefused) {
  const TemporaryFolder folder;
  const StateDirectory state(folder.path());
  std::filesystem::create_directory(folder / "flight.json");
  EXPECT_FALSE(state.load().flight);
}

TEST(SavedFlight, EveryTruncationIsRefused) {
  const std::string text = to_text(some_flight());
  for (std::size_t size = 0; size < text.size(); ++size) {
    const SavedFlightReading reading = parse_saved_flight(text.substr(0, size));
    ASSERT_FALSE(reading.flight) << size;
    ASSERT_FALSE(reading.refusal.empty()) << size;
  }
  EXPECT_FALSE(parse_saved_flight(text + "x").flight);
}

TEST(SavedFlight, EveryFlippedBitIsRefused) {
  const std::string text = to_text(some_flight());
  for (std::size_t i = 0; i < text.size(); ++i) {
    for (const int bit : {0, 3, 6}) {
      std::string damaged = text;
      damaged[i] = static_cast<char>(damaged[i] ^ (1 << bit));
      ASSERT_FALSE(parse_saved_flight(damaged).flight) << i;
    }
  }
}

TEST(SavedFlight, GarbageIsRefused) {
  for (const std::string& text : {std::string("\n"), std::string(60'000, '['), std::string(100, '\0'), sealed(""),
                                  sealed("null"), sealed("[]"), sealed("{}"), sealed("\xff\xfe")}) {
    EXPECT_FALSE(parse_saved_flight(text).flight);
  }
}

// Rightly sealed and still wrong: nobody but us writes such a file, but nothing of it may be believed.
TEST(SavedFlight, WrongValuesAreRefusedByName) {
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
  EXPECT_NE(with("\"sigma_m\":6.25", "\"sigma_m\":-1").refusal.find("sigma_m"), std::string::npos);
  EXPECT_NE(with("\"sigma_m\":6.25", "\"sigma_m\":\"6\"").refusal.find("sigma_m"), std::string::npos);
  EXPECT_NE(with("\"sigma_m\":6.25", "\"sigma\":6.25").refusal.find("sigma_m"), std::string::npos);
  EXPECT_NE(with("\"lat_deg\":-47.376", "\"lat_deg\":-97.376").refusal.find("lat_deg"), std::string::npos);
  EXPECT_NE(with("vo_extrapolated", "divined").refusal.find("source"), std::string::npos);
  EXPECT_NE(with("\"normal\"", "\"abnormal\"").refusal.find("state"), std::string::npos);
  EXPECT_NE(with("nadir.flight/1", "nadir.flight/2").refusal.find("schema"), std::string::npos);
  EXPECT_NE(with("\"segment\":3", "\"segment\":-3").refusal.find("segment"), std::string::npos);
  EXPECT_NE(with("\"segment\":3", "\"segment\":3e9").refusal.find("segment"), std::string::npos);
  EXPECT_NE(with("\"ground_speed_m_s\":24.5", "\"ground_speed_m_s\":1e300").refusal.find("speed"), std::string::npos);
  EXPECT_FALSE(with("\"boot_id\":\"f4a1\"", "\"boot_id\":7").flight);
  EXPECT_FALSE(with("\"segment\":3", "\"segment\":3,\"segment\":4").flight);
}

// A reader at any moment sees a whole state: the old or the new one.
TEST(StateDirectory, AReaderNeverSeesHalfAState) {
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

}  // namespace
}  // namespace nadir
