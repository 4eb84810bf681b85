// What the flight takes from the mission of a signed package.
#include "flight/mission_map.hpp"

#include <gtest/gtest.h>

#include "base/progress.hpp"
#include "package/package_maker.hpp"

namespace nadir {
namespace {

std::unique_ptr<MissionMap> map_of(const std::string& more) {
  const test::TemporaryFolder folder;
  test::PackageMaker maker;
  maker.mission += more;
  NoProgress progress;
  const std::filesystem::path package = maker.make(folder);
  Opening opening = open_package(package, maker.options(), progress);
  EXPECT_TRUE(opening.package) << test::codes(opening.findings);
  return opening.package ? std::make_unique<MissionMap>(std::move(opening.package), package) : nullptr;
}

TEST(MissionMap, TheLocalizerComputesAtTheMissionsRisk) {
  const auto strict = map_of("integrity: {risk: 1.0e-8, alert_limit_m: 25, time_to_alert_s: 6}\n");
  ASSERT_TRUE(strict);
  EXPECT_EQ(strict->config().integrity_risk, 1e-8);
  EXPECT_EQ(strict->integrity().alert_limit_m, 25);
  EXPECT_EQ(strict->integrity().time_to_alert_s, 6);
}

TEST(MissionMap, AMissionThatSaysNothingHasTheDefaultsOfTheLocalizer) {
  const auto usual = map_of("");
  ASSERT_TRUE(usual);
  EXPECT_EQ(usual->config().integrity_risk, LocalizerConfig().integrity_risk);
  EXPECT_EQ(usual->integrity().alert_limit_m, 100);
  EXPECT_EQ(usual->integrity().time_to_alert_s, 3);
}

}  // namespace
}  // namespace nadir
