// nadir mission plan: counts against formulas, the estimate against a real package of the same tiles.
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>

#include "base/files.hpp"
#include "cli/program.hpp"
#include "package/package_maker.hpp"
#include "commands/commands.hpp"

namespace nadir {
namespace {

using nlohmann::json;

class MissionPlan : public ::testing::Test {
 protected:
  int plan(const std::string& yaml, const std::vector<std::string>& more = {}) {
    out_.str("");
    err_.str("");
    std::vector<std::string> args{"mission", "plan", folder_.write("mission.yaml", yaml).string()};
    args.insert(args.end(), more.begin(), more.end());
    return run_program(nadir_text(), all_commands(), args, {out_, err_, clock_});
  }
  json document() const { return json::parse(out_.str()); }

  test::TemporaryFolder folder_;
  FixedClock clock_{test::kJudged};
  std::ostringstream out_, err_;
};

TEST_F(MissionPlan, MeasuresTheGround) {
  ASSERT_EQ(plan(test::mission_yaml(), {"--json"}), 0) << err_.str();
  const json found = document();
  // 0.002 degrees of each at 48 N; the route's legs by hand on the ellipsoid's radii there.
  const double east_m = 74'625, north_m = 111'200;
  EXPECT_NEAR(found["sectors"][0]["km2"].get<double>(), 0.002 * east_m * 0.002 * north_m / 1e6, 0.0002);
  const double route_m = std::hypot(0.004 * east_m, 0.0005 * north_m);
  EXPECT_NEAR(found["route_km"].get<double>(), route_m / 1000, 0.001);
  EXPECT_NEAR(found["corridor_km2"].get<double>(), (route_m * 80 + M_PI * 40 * 40) / 1e6, 0.0003);
  EXPECT_NEAR(found["needed_km2"].get<double>(), 0.0539, 0.0005);
  EXPECT_EQ(found["zooms"].size(), 2U);
}

TEST_F(MissionPlan, CountsTheTilesThatAMissionRequires) {
  ASSERT_EQ(plan(test::mission_yaml(), {"--json"}), 0);
  const auto package = test::PackageMaker().make(folder_);
  std::ostringstream out;
  ASSERT_EQ(
      run_program(nadir_text(), all_commands(), {"cache", "inspect", package.string(), "--json"}, {out, err_, clock_}),
      0);
  EXPECT_EQ(document()["required_tiles"], json::parse(out.str())["imagery"]["tiles"]);
}

TEST_F(MissionPlan, ADiagonalCorridorNeedsFarLessThanItsBox) {
  ASSERT_EQ(plan(test::mission_yaml({{"[11.0040, 48.0005]", "[11.1000, 48.0700]"}}), {"--json"}), 0) << err_.str();
  const json level = document()["zooms"].back();
  EXPECT_LT(level["required_tiles"].get<double>(), 0.1 * level["bounding_box_tiles"].get<double>());
}

TEST_F(MissionPlan, WarnsAboutTheBudgetWithFigures) {
  const std::string yaml = test::mission_yaml({{"max: 18", "max: 22"}, {"budget_mb: 20", "budget_mb: 5"}});
  EXPECT_EQ(plan(yaml, {"--tile-format", "png"}), 0) << "an estimate is no verdict";
  EXPECT_NE(out_.str().find("budget.exceeded"), std::string::npos) << out_.str();
  EXPECT_NE(out_.str().find("png: 98.9 kB and 21 ms per tile, measured"), std::string::npos) << out_.str();
  ASSERT_EQ(plan(yaml, {"--json"}), 0);
  const json one = document();
  ASSERT_EQ(plan(yaml, {"--json", "--threads", "4"}), 0);
  EXPECT_NEAR(document()["build_minutes"].get<double>() * 4, one["build_minutes"].get<double>(), 1e-9);
}

TEST_F(MissionPlan, RejectsOtherFiles) {
  EXPECT_EQ(plan(test::mission_yaml({{"sequence: 3", "sequence: x"}})), 2);
  EXPECT_NE(err_.str().find("mission.yaml:4"), std::string::npos) << err_.str();
  EXPECT_EQ(plan(test::mission_yaml(), {"--tile-format", "gif"}), 2);
  EXPECT_TRUE(out_.str().empty());
}

}  // namespace
}  // namespace nadir
