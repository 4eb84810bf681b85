#include "trust/aircraft_state.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "base/files.hpp"
#include "support/temporary_folder.hpp"
#include "trust/root.hpp"

namespace nadir {
namespace {

TEST(AircraftState, ANewAircraftRemembersNothing) {
  const test::TemporaryFolder folder;
  const AircraftState state = read_state(folder / "state.json");
  EXPECT_TRUE(state.highest_sequence.empty());
  EXPECT_EQ(state.root_version, 0);
  EXPECT_FALSE(state.last_trusted_time);
}

TEST(AircraftState, RoundTripsAndNeverDecreases) {
  const test::TemporaryFolder folder;
  AircraftState state;
  state.accept("a", 5, 2, {1000});
  state.accept("a", 3, 1, {900});
  state.accept("b", 1, 1, {800});
  write_state(folder / "state.json", state);
  const AircraftState back = read_state(folder / "state.json");
  EXPECT_EQ(back.highest_sequence.at("a"), 5);
  EXPECT_EQ(back.highest_sequence.at("b"), 1);
  EXPECT_EQ(back.root_version, 2);
  EXPECT_EQ(back.last_trusted_time, UtcTime{1000});
}

TEST(AircraftState, RemembersTheAirframeFile) {
  const test::TemporaryFolder folder;
  AircraftState state;
  state.accept_airframe("mini-07", 4);
  state.accept_airframe("mini-07", 2);
  state.accept_airframe("mini-08", 1);
  write_state(folder / "state.json", state);
  const AircraftState back = read_state(folder / "state.json");
  EXPECT_EQ(back.airframe_sequence, (std::map<std::string, std::int64_t>{{"mini-07", 4}, {"mini-08", 1}}));
}

// A damaged memory must not pass for an empty one: that would allow every rollback.
TEST(AircraftState, RejectsADamagedFile) {
  const test::TemporaryFolder folder;
  const char* texts[] = {
      "",
      "{}",
      "null",
      R"({"schema":"nadir.state/2","series":{},"root_version":0,"last_trusted_time":null})",
      R"({"schema":"nadir.state/1","series":{"a":-1},"root_version":0,"last_trusted_time":null})",
      R"({"schema":"nadir.state/1","series":{"a":1.5},"root_version":0,"last_trusted_time":null})",
      R"({"schema":"nadir.state/1","series":{"a":1,"a":0},"root_version":0,"last_trusted_time":null})",
      R"({"schema":"nadir.state/1","series":[],"root_version":0,"last_trusted_time":null})",
      R"({"schema":"nadir.state/1","series":{},"root_version":"0","last_trusted_time":null})",
      R"({"schema":"nadir.state/1","series":{},"root_version":0,"last_trusted_time":"yesterday"})",
      R"({"schema":"nadir.state/1","series":{},"root_version":0})",
      R"({"schema":"nadir.state/1","series":{},"root_version":0,"last_trusted_time":null,"roots":[]})",
      R"({"schema":"nadir.state/1","series":{},"root_version":0,"last_trusted_time":null,"airframes":{"a":-1}})",
      R"({"schema":"nadir.state/1","series":{},"root_version":0,"last_trusted_time":null,"airframes":[]})",
      R"({"schema":"nadir.state/1","series":{},"root_version":0,"last_trusted_time":null,"roots":{"2":{}}})",
      R"({"schema":"nadir.state/1","series":{},"root_version":0,"last_trusted_time":null,"x":1})",
  };
  for (const char* text : texts) {
    const auto file = folder.write("state.json", text);
    EXPECT_THROW(read_state(file), Error) << text;
    const StateReading reading = check_state(file);
    EXPECT_FALSE(reading.state) << text;
    EXPECT_TRUE(reading.findings.contains("state.corrupt")) << text;
  }
  std::filesystem::create_directory(folder / "folder");
  EXPECT_THROW(read_state(folder / "folder"), Error);
}

TEST(AircraftState, KeepsTheRootsReceivedWithPackages) {
  const test::TemporaryFolder folder;
  const PrivateKey key = PrivateKey::generate();
  TrustRoot root;
  root.version = 2;
  root.expires = {2'000'000'000};
  root.add_key(key.public_key());
  root.root.key_ids = root.package_signer.key_ids = {key.public_key().id()};
  AircraftState state;
  state.accept("a", 1, 2, {1000}, {{2, sign_root(root, {&key}).json()}});
  write_state(folder / "state.json", state);
  const AircraftState back = read_state(folder / "state.json");
  ASSERT_TRUE(back.roots.contains(2));
  EXPECT_TRUE(check_self(parse_root(back.roots.at(2), "test")).empty());
  AircraftState wrong = state;
  wrong.roots = {{3, state.roots.at(2)}};
  write_state(folder / "state.json", wrong);
  EXPECT_TRUE(check_state(folder / "state.json").findings.contains("state.corrupt"));
}

// A power cut leaves the old file or the new one; half of one would be noticed at every length.
TEST(AircraftState, DetectsEveryTruncation) {
  const test::TemporaryFolder folder;
  AircraftState state;
  state.accept("a", 5, 2, {1000});
  write_state(folder / "state.json", state);
  const std::string whole = read_text_file(folder / "state.json");
  for (std::size_t length = 0; length + 1 < whole.size(); ++length) {
    EXPECT_FALSE(parse_state(whole.substr(0, length), "test").state) << length;
  }
}

TEST(AircraftState, LimitsTheSizeOfItsFile) {
  const test::TemporaryFolder folder;
  std::filesystem::resize_file(folder.write("state.json", "{}"), std::uintmax_t{1} << 40);  // sparse
  EXPECT_TRUE(check_state(folder / "state.json").findings.contains("state.corrupt"));
}

}  // namespace
}  // namespace nadir
