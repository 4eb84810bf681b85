// nadird --check as it is called before take-off: what the aircraft remembers, permits to go back, damage.
#include "nadird_command.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "base/files.hpp"
#include "framework/program.hpp"
#include "package/package_maker.hpp"

namespace nadir {
namespace {

using nlohmann::json;

class NadirdCheck : public ::testing::Test {
 protected:
  NadirdCheck() {
    folder_.write("root.json", sign_root(maker_.root, {&maker_.signer}).json());
    older_ = maker_.make(folder_, "older").string();
    maker_.mission = test::mission_yaml({{"sequence: 3", "sequence: 4"}});
    newer_ = maker_.make(folder_, "newer").string();
  }
  int check(const std::string& package, std::initializer_list<std::string> more = {}) {
    std::vector<std::string> args{"--package",        package,   "--trust", path("root.json"), "--state",
                                  path("state.json"), "--check", "--json"};
    args.insert(args.end(), more);
    out_.str("");
    err_.str("");
    NadirdCommand command;
    return run_single_command("nadird", command, args, {out_, err_, clock_});
  }
  void permit(const std::string& name, std::int64_t from, std::int64_t to) {
    const UtcTime expires{test::kJudged.unix_s + 86'400};
    folder_.write(name, sign_permit({"village", from, to, std::nullopt, expires}, {&maker_.signer}).document.json());
  }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  std::string first_code() const { return json::parse(out_.str())["findings"][0]["code"]; }

  test::TemporaryFolder folder_;
  FixedClock clock_{test::kJudged};
  std::ostringstream out_, err_;
  test::PackageMaker maker_;
  std::string older_, newer_;
};

TEST_F(NadirdCheck, RemembersAndRefusesWhatIsOlder) {
  EXPECT_EQ(check(older_), 0) << out_.str() << err_.str();
  EXPECT_EQ(check(newer_), 0) << out_.str();
  EXPECT_TRUE(json::parse(out_.str())["ready"]);
  EXPECT_EQ(check(older_), 1);
  EXPECT_EQ(first_code(), "package.rollback");
}

TEST_F(NadirdCheck, APermitAllowsOneStepBack) {
  ASSERT_EQ(check(newer_), 0) << out_.str();
  permit("permit.json", 4, 3);
  permit("other.json", 5, 3);
  EXPECT_EQ(check(older_, {"--permit", path("other.json")}), 1);
  EXPECT_EQ(check(older_, {"--permit", path("permit.json")}), 0) << out_.str();
  EXPECT_EQ(check(older_), 1) << "the memory did not go down";
}

TEST_F(NadirdCheck, ADamagedPermitIsAFinding) {
  folder_.write("permit.json", "{\"signed\": {");
  EXPECT_EQ(check(newer_, {"--permit", path("permit.json")}), 1);
  EXPECT_EQ(first_code(), "permit.invalid");
  EXPECT_FALSE(std::filesystem::exists(path("state.json"))) << "nothing was accepted";
  EXPECT_EQ(check(newer_, {"--permit", path("none.json")}), 2);
}

TEST_F(NadirdCheck, ADamagedStateIsAFindingAndStaysAsItIs) {
  for (const std::string state : {"", "{\"schema\":", "[]", "\xff\xfe"}) {
    folder_.write("state.json", state);
    EXPECT_EQ(check(newer_), 1) << state;
    EXPECT_EQ(first_code(), "state.corrupt");
    EXPECT_EQ(read_text_file(folder_ / "state.json"), state);
  }
}

}  // namespace
}  // namespace nadir
