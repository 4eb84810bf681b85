#include "package/mission.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "package/package_maker.hpp"

namespace nadir {
namespace {

using test::mission_yaml;

TEST(Mission, ReadsEverything) {
  const MissionReading reading = parse_mission(mission_yaml(), "mission.yaml");
  ASSERT_TRUE(reading.mission) << test::codes(reading.findings);
  const Mission& mission = *reading.mission;
  EXPECT_EQ(mission.id, "village-a");
  EXPECT_EQ(mission.series, "village");
  EXPECT_EQ(mission.sequence, 3);
  EXPECT_EQ(to_rfc3339(mission.created), "2024-04-20T00:00:00Z");
  EXPECT_EQ(to_rfc3339(mission.expires), "2024-06-01T00:00:00Z");
  EXPECT_EQ(mission.takeoff, (LonLat{11.0, 48.0}));
  EXPECT_TRUE(mission.terrain.flat);
  EXPECT_EQ(mission.zoom.min, 17);
  EXPECT_EQ(mission.zoom.max, 18);
  EXPECT_EQ(mission.freshness_days.of(SectorClass::stable), 730);
  EXPECT_EQ(mission.freshness_days.of(SectorClass::active), 90);
  ASSERT_EQ(mission.sectors.size(), 1U);
  EXPECT_EQ(mission.sectors[0].cls, SectorClass::stable);
  EXPECT_EQ(mission.sectors[0].polygon.size(), 4U);  // without the closing point
  EXPECT_EQ(mission.route.points.size(), 2U);
  EXPECT_TRUE(mission.allows("mini-07"));
  EXPECT_FALSE(mission.allows("mini-09"));
}

TEST(Mission, TerrainIsFlatOrAnElevationModel) {
  const auto terrain = [](const std::string& text) {
    return parse_mission(mission_yaml({{"{mode: flat}", text}}), "mission.yaml").mission.value().terrain;
  };
  EXPECT_TRUE(terrain("{mode: flat, height_m: 430}").flat);
  EXPECT_EQ(terrain("{mode: flat, height_m: 430}").height_m, 430);
  EXPECT_FALSE(terrain("{mode: dem}").flat);
}

TEST(Mission, IntegrityIsOptionalAsAWholeAndInEachValue) {
  const auto integrity = [](const std::string& text) {
    return parse_mission(mission_yaml() + text, "mission.yaml").mission.value().integrity;
  };
  const IntegrityRequirement by_default = integrity("");
  EXPECT_EQ(by_default.risk, 1e-5);
  EXPECT_EQ(by_default.alert_limit_m, 100);
  EXPECT_EQ(by_default.time_to_alert_s, 3);
  EXPECT_EQ(integrity("integrity: {alert_limit_m: 40}\n").alert_limit_m, 40);
  EXPECT_EQ(integrity("integrity: {alert_limit_m: 40}\n").risk, 1e-5);
  const IntegrityRequirement all = integrity("integrity: {risk: 1.0e-7, alert_limit_m: 25, time_to_alert_s: 6}\n");
  EXPECT_EQ(all.risk, 1e-7);
  EXPECT_EQ(all.alert_limit_m, 25);
  EXPECT_EQ(all.time_to_alert_s, 6);
}

TEST(Mission, RegionIsInMetresAroundTakeOff) {
  const Mission mission = *parse_mission(mission_yaml(), "mission.yaml").mission;
  const Region region = required_region(mission, mission_frame(mission));
  ASSERT_EQ(region.rings.size(), 1U);
  ASSERT_EQ(region.corridors.size(), 1U);
  // 0.002° by 0.002° at 48° north: 149.2 m by 222.4 m (GeographicLib's own figures for WGS84).
  EXPECT_NEAR(std::abs(area_m2(region.rings[0])), 149.2 * 222.4, 60);
  EXPECT_TRUE(region.contains({0, 0}));
  EXPECT_TRUE(region.contains({200, 10}));    // corridor
  EXPECT_FALSE(region.contains({200, 100}));  // beside it
}

struct Fault {
  const char* name;
  std::string from, to;
  const char* where;  // line:column
};
void PrintTo(const Fault& fault, std::ostream* out) { *out << fault.name; }

class MissionFault : public ::testing::TestWithParam<Fault> {};

TEST_P(MissionFault, IsReportedAtItsPlace) {
  const Fault& fault = GetParam();
  const MissionReading reading = parse_mission(mission_yaml({{fault.from, fault.to}}), "m.yaml");
  EXPECT_FALSE(reading.mission);
  ASSERT_EQ(reading.findings.items().size(), 1U) << test::codes(reading.findings);
  const Finding& finding = reading.findings.items()[0];
  EXPECT_EQ(finding.code, "mission.schema");
  EXPECT_TRUE(finding.where.starts_with("m.yaml:" + std::string(fault.where))) << finding.where;
  EXPECT_FALSE(finding.found.empty());
}

INSTANTIATE_TEST_SUITE_P(
    All, MissionFault,
    ::testing::Values(
        Fault{"schema", "nadir.mission/1", "nadir.mission/2", "1:9"},
        Fault{"id_with_slash", "id: village-a", "id: ../village", "2:5"},
        Fault{"id_empty", "id: village-a", "id: ''", "2:5"}, Fault{"missing_series", "series: village\n", "", "1:1"},
        Fault{"sequence", "sequence: 3", "sequence: 0", "4:11"},
        Fault{"sequence_float", "sequence: 3", "sequence: 3.5", "4:11"},
        Fault{"created", "created: 2024-04-20", "created: 2024-02-30", "5:10"},
        Fault{"expires_before_created", "expires: 2024-06-01", "expires: 2024-04-01", "6:10"},
        Fault{"latitude", "lat_deg: 48.0000}", "lat_deg: 98.0}", "7:38"},
        Fault{"nan", "lat_deg: 48.0000}", "lat_deg: nan}", "7:38"},
        Fault{"terrain", "mode: flat", "mode: hilly", "8:17"}, Fault{"zoom_order", "min: 17", "min: 19", "9:7"},
        Fault{"zoom_deep", "max: 18", "max: 30", "9:22"},
        Fault{"resolution_negative", "min_resolution_m: 0.5", "min_resolution_m: -1", "10:19"},
        Fault{"resolution_finer_than_zoom", "min_resolution_m: 0.5", "min_resolution_m: 0.3", "10:19"},
        Fault{"budget", "budget_mb: 20", "budget_mb: 0", "11:12"},
        Fault{"freshness", "stable: 730", "stable: -1", "12:26"},
        Fault{"airframes_empty", "[mini-07, mini-08]", "[]", "13:12"},
        Fault{"airframes_twice", "[mini-07, mini-08]", "[mini-07, mini-07]", "13:"},
        Fault{"unknown_key", "budget_mb: 20", "budget_mb: 20\nbugdet_mb: 20", "12:1"},
        Fault{"duplicate_key", "budget_mb: 20", "budget_mb: 20\nbudget_mb: 20", "12:1"},
        Fault{"class", "class: stable", "class: calm", "16:12"},
        Fault{"ring_open", ", [10.9990, 47.9990]]", "]", "17:14"},
        Fault{"ring_crosses", "[11.0010, 47.9990], [11.0010, 48.0010]", "[11.0010, 48.0010], [11.0010, 47.9990]",
              "17:14"},
        Fault{"ring_tiny", "[11.0010, 47.9990], [11.0010, 48.0010], [10.9990, 48.0010]",
              "[10.99901, 47.9990], [10.99901, 47.99901], [10.9990, 47.99901]", "17:14"},
        Fault{"ring_far",
              "[[10.9990, 47.9990], [11.0010, 47.9990], [11.0010, 48.0010], [10.9990, 48.0010], [10.9990, 47.9990]]",
              "[[47.9990, 10.9990], [47.9990, 11.0010], [48.0010, 11.0010], [48.0010, 10.9990], [47.9990, 10.9990]]",
              "17:14"},
        Fault{"corridor", "half_width_m: 40", "half_width_m: 0", "19:26"},
        Fault{"route_short", "[[11.0000, 48.0000], [11.0040, 48.0005]]", "[[11.0000, 48.0000]]", "21:11"},
        Fault{"route_stands", "[11.0040, 48.0005]", "[11.0000, 48.0000]", "21:11"},
        Fault{"point_of_three", "[11.0040, 48.0005]", "[11.0040, 48.0005, 100]", "21:"},
        Fault{"risk_never", "expires:", "integrity: {risk: 0}\nexpires:", "6:19"},
        Fault{"risk_often", "expires:", "integrity: {risk: 0.011}\nexpires:", "6:19"},
        Fault{"risk_nan", "expires:", "integrity: {risk: .nan}\nexpires:", "6:19"},
        Fault{"alert_limit_small", "expires:", "integrity: {alert_limit_m: 0.9}\nexpires:", "6:28"},
        Fault{"alert_limit_large", "expires:", "integrity: {alert_limit_m: 10001}\nexpires:", "6:28"},
        Fault{"alert_limit_text", "expires:", "integrity: {alert_limit_m: near}\nexpires:", "6:28"},
        Fault{"time_to_alert_short", "expires:", "integrity: {time_to_alert_s: 0.4}\nexpires:", "6:30"},
        Fault{"time_to_alert_long", "expires:", "integrity: {time_to_alert_s: 61}\nexpires:", "6:30"},
        Fault{"integrity_key", "expires:", "integrity: {alarm_limit_m: 50}\nexpires:", "6:"},
        Fault{"integrity_list", "expires:", "integrity: [1.0e-5]\nexpires:", "6:"},
        Fault{"integrity_empty", "expires:", "integrity:\nexpires:", "7:1"},
        Fault{"alias", "series: village", "series: *x", "3:"}),
    [](const auto& param) { return param.param.name; });

TEST(Mission, CollectsAllErrors) {
  const MissionReading reading = parse_mission(
      mission_yaml({{"sequence: 3", "sequence: x"}, {"budget_mb: 20", "budget_mb: y"}, {"stable: 730", "stable: z"}}),
      "m.yaml");
  EXPECT_EQ(reading.findings.items().size(), 3U);
}

TEST(Mission, AnInvalidMissionIsAFinding) {
  for (const char* text : {"", "[]", "just text", "a: [", "\x01\x02", "{}"}) {
    const MissionReading reading = parse_mission(text, "m.yaml");
    EXPECT_FALSE(reading.mission) << text;
    EXPECT_TRUE(reading.findings.contains("mission.schema")) << text;
  }
}

TEST(Mission, ReadMissionThrowsTheFirstFinding) {
  const test::TemporaryFolder folder;
  EXPECT_THROW(read_mission(folder.write("m.yaml", mission_yaml({{"sequence: 3", "sequence: x"}}))), UsageError);
  EXPECT_THROW(read_mission(folder / "none.yaml"), Error);
  EXPECT_EQ(read_mission(folder.write("good.yaml", mission_yaml())).id, "village-a");
}

}  // namespace
}  // namespace nadir
