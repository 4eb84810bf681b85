// keys, mission and cache commands as a user calls them: exit codes, and what goes to stdout and stderr.
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "base/files.hpp"
#include "commands/command_fixture.hpp"
#include "package/package_maker.hpp"

namespace nadir {
namespace {

class Commands : public test::CommandTest {};

TEST_F(Commands, KeysAndRootsOverTwoGenerations) {
  for (const char* name : {"r", "r2", "p"}) ASSERT_EQ(run({"keys", "create", "--out", path(name)}), 0) << err_.str();
  EXPECT_EQ(run({"keys", "create", "--out", path("r")}), 2);
  const std::vector<std::string> first{
      "keys",      "root",       "--root-key", path("r.key.pem"), "--package-signer", path("p.pub.pem"),
      "--expires", "2030-01-01", "--out",      path("root.json")};
  ASSERT_EQ(run(first), 0) << err_.str();
  EXPECT_EQ(run(first), 2) << "a root is never overwritten";

  std::vector<std::string> second{"keys",
                                  "root",
                                  "--root-key",
                                  path("r2.key.pem"),
                                  "--package-signer",
                                  path("p.pub.pem"),
                                  "--expires",
                                  "2031-01-01",
                                  "--previous",
                                  path("root.json"),
                                  "--out",
                                  path("2.root.json")};
  EXPECT_EQ(run(second), 2) << "the old root has not signed";
  EXPECT_FALSE(std::filesystem::exists(path("2.root.json")));
  second.insert(second.end(), {"--previous-root-key", path("r.key.pem"), "--json"});
  ASSERT_EQ(run(second), 0) << err_.str();
  EXPECT_EQ(nlohmann::json::parse(out_.str())["version"], 2);
}

TEST_F(Commands, RejectsRootsThatCannotWork) {
  ASSERT_EQ(run({"keys", "create", "--out", path("k")}), 0);
  const auto root = [&](std::initializer_list<std::string> more) {
    std::vector<std::string> args{
        "keys",  "root",           "--root-key", path("k.key.pem"), "--package-signer", path("k.pub.pem"),
        "--out", path("root.json")};
    args.insert(args.end(), more);
    return run(args);
  };
  EXPECT_EQ(root({"--expires", "2020-01-01"}), 2);
  EXPECT_EQ(root({"--expires", "2030-01-01", "--threshold", "2"}), 2);
  EXPECT_EQ(root({"--expires", "2030-01-01", "--tile-signer", "no-key"}), 2);
  EXPECT_EQ(root({"--expires", "someday"}), 2);
  EXPECT_FALSE(std::filesystem::exists(path("root.json")));
  EXPECT_EQ(root({"--expires", "2030-01-01", "--tile-signer", "mini-07=" + path("k.pub.pem")}), 0) << err_.str();
}

TEST_F(Commands, MissionCheck) {
  folder_.write("good.yaml", test::mission_yaml());
  folder_.write("bad.yaml", test::mission_yaml({{"sequence: 3", "sequence: x"}}));
  EXPECT_EQ(run({"mission", "check", path("good.yaml")}), 0);
  EXPECT_TRUE(err_.str().empty());
  EXPECT_EQ(run({"mission", "check", path("bad.yaml"), "--json"}), 1);
  EXPECT_EQ(nlohmann::json::parse(out_.str())["findings"][0]["code"], "mission.schema");
  EXPECT_EQ(run({"mission", "check", path("none.yaml")}), 2);
  EXPECT_TRUE(out_.str().empty());
}

TEST_F(Commands, VerifyRemembersWhatItAccepted) {
  test::PackageMaker maker;
  write_file_atomic(folder_ / "root.json", sign_root(maker.root, {&maker.signer}).json());
  const std::string older = maker.make(folder_, "older").string();
  maker.mission = test::mission_yaml({{"sequence: 3", "sequence: 4"}});
  const std::string newer = maker.make(folder_, "newer").string();
  const auto verify = [&](const std::string& package) {
    return run({"cache", "verify", package, "--trust", path("root.json"), "--state", path("state.json"), "--json"});
  };
  EXPECT_EQ(verify(older), 0) << out_.str() << err_.str();
  EXPECT_EQ(verify(newer), 0);
  EXPECT_EQ(verify(older), 1);
  EXPECT_EQ(nlohmann::json::parse(out_.str())["findings"][0]["code"], "package.rollback");
  EXPECT_EQ(verify(newer), 0) << "a refused package changes nothing";
  EXPECT_EQ(verify(path("none")), 2);
}

TEST_F(Commands, AForgedPackageNameStaysOnItsLine) {
  EXPECT_EQ(run({"cache", "inspect", path("valley\n  found:    accepted\x1b[2J")}), 2);
  const std::string message = err_.str();
  EXPECT_EQ(std::count(message.begin(), message.end(), '\n'), 2) << message;
  EXPECT_NE(err_.str().find("valley⏎  found:    accepted?[2J"), std::string::npos) << err_.str();
}

// For a clock that starts in 1970 every date is in the future, and for one that runs ahead none is.
TEST_F(Commands, AWrongClockIsNamed) {
  for (const char* name : {"r", "p"}) ASSERT_EQ(run({"keys", "create", "--out", path(name)}), 0) << err_.str();
  const std::vector<std::string> root{
      "keys",      "root",       "--root-key", path("r.key.pem"), "--package-signer", path("p.pub.pem"),
      "--expires", "2030-01-01", "--out",      path("root.json")};
  clock_ = FixedClock({0});
  EXPECT_EQ(run(root), 2);
  EXPECT_NE(err_.str().find("the clock of this machine is wrong"), std::string::npos) << err_.str();
  EXPECT_NE(err_.str().find("1970-01-01"), std::string::npos) << err_.str();
  clock_ = FixedClock({2'500'000'000});
  EXPECT_EQ(run(root), 2);
  EXPECT_NE(err_.str().find("set the clock, if it is wrong"), std::string::npos) << err_.str();
  EXPECT_FALSE(std::filesystem::exists(path("root.json")));
}

TEST_F(Commands, InspectAndValidate) {
  const test::PackageMaker maker;
  const std::filesystem::path package = maker.make(folder_);
  folder_.write("mission.yaml", test::mission_yaml());
  EXPECT_EQ(run({"cache", "inspect", package.string(), "--get", "manifest.mission.sequence"}), 0) << err_.str();
  EXPECT_EQ(out_.str(), "3\n");
  EXPECT_EQ(run({"cache", "inspect", package.string(), "--get", "no.such"}), 2);
  EXPECT_EQ(run({"cache", "inspect", path("none")}), 2);
  const std::string tiles = (package / kImageryFile).string();
  EXPECT_EQ(run({"cache", "validate", tiles, "--mission", path("mission.yaml")}), 0) << out_.str();
  test::sqlite(tiles, "DELETE FROM tiles WHERE zoom_level = 18");
  EXPECT_EQ(run({"cache", "validate", tiles, "--mission", path("mission.yaml")}), 1);
  EXPECT_NE(out_.str().find("coverage.gap"), std::string::npos);
  EXPECT_EQ(run({"cache", "validate", path("mission.yaml"), "--mission", path("mission.yaml")}), 2);
}

}  // namespace
}  // namespace nadir
