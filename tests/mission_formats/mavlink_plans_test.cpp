// QGroundControl's plans and MAVLink's waypoints, in miniature as those programs write them.
#include "mission_formats/mavlink_plans.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "mission_formats/sample_mission.hpp"

namespace nadir {
namespace {

std::string item(int command, int frame, const std::string& place) {
  return fmt::format(R"({{"type":"SimpleItem","autoContinue":true,"command":{},"doJumpId":1,"frame":{},
    "AMSLAltAboveTerrain":null,"Altitude":50,"AltitudeMode":1,"params":[15,0,0,null,{}]}})",
                     command, frame, place);
}

std::string plan(const std::string& items, const std::string& fence = R"({"circles":[],"polygons":[],"version":2})") {
  return R"({"fileType":"Plan","version":1,"groundStation":"QGroundControl","geoFence":)" + fence +
         R"(,"mission":{"version":2,"cruiseSpeed":15,"firmwareType":12,"hoverSpeed":5,"vehicleType":2,
         "plannedHomePosition":[47.3977,8.5456,488.5],"items":[)" +
         items + R"(]},"rallyPoints":{"points":[[47.1,8.5,50]],"version":2}})";
}

std::string refusal(const std::function<void()>& read) {
  try {
    read();
  } catch (const Error& error) {
    return error.what();
  }
  return "accepted";
}

TEST(MavlinkPlans, APlanHasRouteHeightsHomeAndFences) {
  const MissionDrawing drawing = read_plan(
      plan(
          item(530, 2, "null,null,null") + "," + item(22, 3, "47.3978,8.5457,50") + "," + item(16, 3, "47.40,8.55,80") +
              "," + item(206, 2, "0,0,0") + "," + item(20, 2, "0,0,0"),
          R"({"version":2,"polygons":[{"inclusion":false,"version":1,"polygon":[[47.4,8.54],[47.41,8.54],[47.41,8.55]]},
              {"inclusion":true,"version":1,"polygon":[[47,8],[48,8],[48,9]]}],
              "circles":[{"inclusion":false,"version":1,"circle":{"center":[47.42,8.56],"radius":120.5}}]})"),
      "a.plan");
  ASSERT_EQ(drawing.lines.size(), 1U);
  EXPECT_EQ(drawing.lines[0].points, (std::vector<LonLat>{{8.5457, 47.3978}, {8.55, 47.40}}));
  EXPECT_EQ(drawing.lines[0].heights_m, (std::vector<double>{50, 80}));
  EXPECT_EQ(drawing.lines[0].frame, HeightFrame::above_takeoff);
  EXPECT_EQ(drawing.takeoff, (LonLat{8.5456, 47.3977}));
  EXPECT_EQ(drawing.takeoff_height_m, 488.5);
  ASSERT_EQ(drawing.areas.size(), 2U);
  EXPECT_EQ(drawing.areas[0].polygon.size(), 3U);
  EXPECT_EQ(drawing.areas[1].radius_m, 120.5);
  std::string notes;
  for (const Finding& note : drawing.notes.items()) notes += note.found + "; ";
  EXPECT_NE(notes.find("a fence that includes"), std::string::npos) << notes;
  EXPECT_NE(notes.find("a rally point"), std::string::npos) << notes;
  EXPECT_NE(notes.find("return to launch"), std::string::npos) << notes;
}

TEST(MavlinkPlans, EachPointKeepsItsFrame) {
  for (const auto& [number, frame] :
       {std::pair(0, HeightFrame::above_sea_level), {3, HeightFrame::above_takeoff}, {10, HeightFrame::above_ground}}) {
    const auto drawing =
        read_plan(plan(item(16, number, "47.4,8.5,80") + "," + item(16, number, "47.41,8.5,80")), "a.plan");
    EXPECT_EQ(drawing.lines.at(0).frame, frame);
  }
  const MissionDrawing mixed = read_plan(
      plan(item(16, 3, "47.4,8.5,80") + "," + item(16, 10, "47.41,8.5,60") + "," + item(16, 0, "47.42,8.5,480")),
      "a.plan");
  EXPECT_EQ(mixed.lines.at(0).frames,
            (std::vector{HeightFrame::above_takeoff, HeightFrame::above_ground, HeightFrame::above_sea_level}));
  EXPECT_EQ(mixed.lines[0].heights_m, (std::vector<double>{80, 60, 480}));
  const std::string local = refusal([] { read_plan(plan(item(16, 1, "47.4,8.5,80")), "a.plan"); });
  EXPECT_NE(local.find("frame 1 (local, north-east-down)"), std::string::npos) << local;
}

TEST(MavlinkPlans, ItemsOfOldPlansHaveTheirPlaceBesideTheParameters) {
  const auto old = [](int command, int frame, const std::string& coordinate, const std::string& params = "0,0,0,null") {
    return fmt::format(
        R"({{"type":"SimpleItem","autoContinue":true,"command":{},"coordinate":[{}],"doJumpId":1,"frame":{},"params":[{}]}})",
        command, coordinate, frame, params);
  };
  const MissionDrawing drawing =
      read_plan(plan(old(22, 3, "47.3978,8.5457,20") + "," + old(16, 3, "47.40,8.55,30") + "," + old(205, 2, "0,0,2"),
                     R"({"polygon":[],"version":1})"),
                "old.plan");
  EXPECT_EQ(drawing.lines.at(0).points, (std::vector<LonLat>{{8.5457, 47.3978}, {8.55, 47.40}}));
  EXPECT_EQ(drawing.lines[0].heights_m, (std::vector<double>{20, 30}));
  const auto fenced =
      read_plan(plan(old(16, 3, "47.40,8.55,30"), R"({"polygon":[[47,8],[48,8],[48,9]],"version":1})"), "old.plan");
  EXPECT_TRUE(fenced.areas.empty());
  EXPECT_EQ(fenced.notes.items().at(0).found.find("a fence that includes"), 0U);
  EXPECT_NE(refusal([&] { read_plan(plan(old(16, 3, "47.4,8.5")), "old.plan"); }), "accepted");
  EXPECT_NE(refusal([&] { read_plan(plan(old(16, 3, "47.4,8.5,20", "0,0,0,null,47.4,8.5,20")), "old.plan"); }),
            "accepted");
}

TEST(MavlinkPlans, SurveysAndLandingPatternsAreFlown) {
  const std::string survey = R"({"type":"ComplexItem","complexItemType":"survey","version":5,"angle":0,
    "polygon":[[47.40,8.54],[47.41,8.54],[47.41,8.55],[47.40,8.55]],"TransectStyleComplexItem":{"version":1,"Items":[)" +
                             item(16, 3, "47.401,8.541,60") + "," + item(206, 2, "0,0,0") + "," +
                             item(16, 3, "47.409,8.541,60") + "]}}";
  const std::string landing =
      R"({"type":"ComplexItem","complexItemType":"fwLandingPattern","version":1,"altitudesAreRelative":true,
    "landCoordinate":[47.398,8.545,0],"loiterCoordinate":[47.399,8.546,40],"loiterRadius":75})";
  const MissionDrawing drawing = read_plan(plan(survey + "," + landing), "a.plan");
  ASSERT_EQ(drawing.lines.size(), 1U);
  EXPECT_EQ(drawing.lines[0].heights_m, (std::vector<double>{60, 60, 40, 0}));
  ASSERT_EQ(drawing.areas.size(), 1U);
  EXPECT_EQ(drawing.areas[0].kind, AreaKind::sector);
  const std::string structure =
      refusal([] { read_plan(plan(R"({"type":"ComplexItem","complexItemType":"StructureScan"})"), "a.plan"); });
  EXPECT_NE(structure.find("StructureScan"), std::string::npos) << structure;
}

TEST(MavlinkPlans, DamagedPlansAreRefused) {
  const std::string sound = plan(item(16, 3, "47.4,8.5,80") + "," + item(16, 3, "47.5,8.5,80"));
  ASSERT_NO_THROW(read_plan(sound, "a.plan"));
  for (std::size_t cut = 1; cut < sound.size(); cut += 7) {
    EXPECT_NE(refusal([&] { read_plan(sound.substr(0, cut), "a.plan"); }), "accepted") << cut;
  }
  const auto broken = [&](const std::string& from, const std::string& to) {
    std::string text = sound;
    text.replace(text.find(from), from.size(), to);
    return refusal([&] { read_plan(text, "a.plan"); });
  };
  EXPECT_NE(broken("47.4,8.5,80", "147.4,8.5,80").find("swapped"), std::string::npos);
  EXPECT_NE(broken("47.4,8.5,80", "NaN,8.5,80"), "accepted");
  EXPECT_NE(broken("47.4,8.5,80", "47.4,8.5,null").find("no height"), std::string::npos);
  EXPECT_NE(broken("47.4,8.5,80", "47.4,8.5").find("/params"), std::string::npos);
  EXPECT_NE(broken("47.4,8.5,80", "47.4,8.5,1e999"), "accepted");
  EXPECT_NE(broken("\"version\":1", "\"version\":9"), "accepted");
  EXPECT_NE(broken("\"SimpleItem\"", "\"FunnyItem\""), "accepted");
  EXPECT_NE(broken("\"command\":16", "\"command\":-1"), "accepted");
  const std::string deep = R"({"fileType":"Plan","x":)" + std::string(100'000, '[') + std::string(100'000, ']') + "}";
  EXPECT_NE(refusal([&] { read_plan(deep, "a.plan"); }), "accepted");
  EXPECT_NE(refusal([] { read_plan(R"({"MAV_AUTOPILOT":3,"items":[]})", "old.mission"); }).find("old QGroundControl"),
            std::string::npos);
}

constexpr const char* kRows =
    "QGC WPL 110\r\n"
    "0\t1\t0\t16\t0.000000\t0.000000\t0.000000\t0.000000\t-35.363262\t149.165237\t584.080000\t1\r\n"
    "1\t0\t3\t22\t15.000000\t0.000000\t0.000000\t0.000000\t0.000000\t0.000000\t30.000000\t1\r\n"
    "2\t0\t3\t16\t0.000000\t0.000000\t0.000000\t0.000000\t-35.361279\t149.161178\t80.000000\t1\r\n"
    "3\t0\t3\t16\t0.000000\t0.000000\t0.000000\t0.000000\t-35.359591\t149.160339\t90.000000\t1\r\n"
    "4\t0\t3\t20\t0.000000\t0.000000\t0.000000\t0.000000\t0.000000\t0.000000\t0.000000\t1\r\n";

TEST(MavlinkPlans, WaypointsAsMissionPlannerWritesThem) {
  const MissionDrawing drawing = read_waypoints(kRows, "a.waypoints");
  EXPECT_EQ(drawing.takeoff, (LonLat{149.165237, -35.363262}));
  EXPECT_EQ(drawing.takeoff_height_m, 584.08);
  ASSERT_EQ(drawing.lines.size(), 1U);
  EXPECT_EQ(drawing.lines[0].points, (std::vector<LonLat>{{149.161178, -35.361279}, {149.160339, -35.359591}}));
  EXPECT_EQ(drawing.lines[0].heights_m, (std::vector<double>{80, 90}));
  EXPECT_FALSE(drawing.holds_areas);
}

// A survey above ground by Mission Planner's grid: triggers between the lines, a landing that is counted from take-off.
TEST(MavlinkPlans, ASurveyAboveGroundThatLandsAboveTakeOff) {
  const auto row = [](int n, int frame, int command, const std::string& place) {
    return fmt::format("{}\t0\t{}\t{}\t0.00000000\t0.00000000\t0.00000000\t0.00000000\t{}\t1\n", n, frame, command,
                       place);
  };
  const std::string rows =
      "QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t-35.363262\t149.165237\t584.08\t1\n" +
      row(1, 3, 22, "0.00000000\t0.00000000\t50.000000") + row(2, 10, 16, "-35.36107110\t149.16166840\t60.000000") +
      row(3, 0, 206, "0\t0\t0") + row(4, 10, 16, "-35.36167370\t149.16206520\t60.000000") + row(5, 0, 189, "0\t0\t0") +
      row(6, 3, 31, "-35.36219980\t149.16311710\t40.000000") + row(7, 0, 21, "-35.36326200\t149.16523700\t584.080000");
  const MissionDrawing drawing = read_waypoints(rows, "survey.waypoints");
  ASSERT_EQ(drawing.lines.size(), 1U);
  EXPECT_EQ(drawing.lines[0].frames, (std::vector{HeightFrame::above_ground, HeightFrame::above_ground,
                                                  HeightFrame::above_takeoff, HeightFrame::above_sea_level}));
  MissionImportOptions options;
  options.id = "survey";
  options.today = *parse_utc("2026-05-01");
  const ImportedMission imported = mission_from_drawing(drawing, options, "survey.waypoints");
  for (const Finding& finding : imported.reading.findings.items()) ADD_FAILURE() << to_text(finding);
  ASSERT_TRUE(imported.reading.mission);
  const Mission& mission = *imported.reading.mission;
  EXPECT_EQ(mission.route.height_frames, drawing.lines[0].frames);
  EXPECT_NEAR(height_above_ground_m(mission, 1, 600, 584.08), 60, 1e-9);
  EXPECT_NEAR(height_above_ground_m(mission, 2, 600, 584.08), 24.08, 1e-9);
  EXPECT_NEAR(height_above_ground_m(mission, 3, 584.08, 584.08), 0, 1e-9);
  EXPECT_EQ(height_frames_of(mission.route), "above_ground and above_takeoff and above_sea_level");
}

TEST(MavlinkPlans, FencesOfArduPilotAreNoFlyAreas) {
  const auto row = [](int n, int command, double p1, double lat, double lon) {
    return fmt::format("{}\t0\t3\t{}\t{}\t0\t0\t0\t{}\t{}\t0\t1\n", n, command, p1, lat, lon);
  };
  const std::string fence = "QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t-35.36\t149.16\t584\t1\n" +
                            row(1, 5002, 3, -35.1, 149.1) + row(2, 5002, 3, -35.2, 149.1) +
                            row(3, 5002, 3, -35.2, 149.2) + row(4, 5004, 150, -35.3, 149.1);
  const MissionDrawing drawing = read_waypoints(fence, "fence.txt");
  ASSERT_EQ(drawing.areas.size(), 2U);
  EXPECT_EQ(drawing.areas[0].polygon.size(), 3U);
  EXPECT_EQ(drawing.areas[1].radius_m, 150);
  EXPECT_NE(refusal([&] { read_waypoints(fence.substr(0, fence.find("3\t0\t3")), "fence.txt"); }).find("not complete"),
            std::string::npos);
}

TEST(MavlinkPlans, DamagedWaypointsAreRefused) {
  const std::string sound = kRows;
  const auto broken = [&](const std::string& from, const std::string& to) {
    std::string text = sound;
    text.replace(text.find(from), from.size(), to);
    return refusal([&] { read_waypoints(text, "a.waypoints"); });
  };
  EXPECT_NE(broken("QGC WPL 110", "QGC WPL 999").find("QGC WPL 110"), std::string::npos);
  EXPECT_NE(broken("-35.361279\t", "").find("a.waypoints:4"), std::string::npos);
  EXPECT_NE(broken("-35.361279", "nan"), "accepted");
  EXPECT_NE(broken("-35.361279", "-95.3").find("outside of the world"), std::string::npos);
  EXPECT_NE(broken("-35.361279", "north").find("a number"), std::string::npos);
  EXPECT_NE(broken("3\t0\t3\t16", "3\t0\t99\t16").find("frame 99"), std::string::npos);
  std::string many = "QGC WPL 110\n";
  for (int i = 0; i < 20'100; ++i) many += "1\t0\t3\t16\t0\t0\t0\t0\t1\t1\t1\t1\n";
  EXPECT_NE(refusal([&] { read_waypoints(many, "a.waypoints"); }).find("too many"), std::string::npos);
}

TEST(MavlinkPlans, WhatWeWriteIsWhatGroundStationsRead) {
  const auto document = nlohmann::json::parse(mission_as_plan(test::sample_mission()));
  EXPECT_EQ(document["fileType"], "Plan");
  EXPECT_EQ(document["mission"]["items"].size(), 3U);
  EXPECT_EQ(document["mission"]["items"][1]["frame"], 3);
  EXPECT_EQ(document["mission"]["items"][1]["params"][6], 120.1);
  EXPECT_EQ(document["geoFence"]["polygons"][0]["inclusion"], false);
  const std::string rows = mission_as_waypoints(test::sample_mission());
  EXPECT_EQ(std::count(rows.begin(), rows.end(), '\n'), 5);
  EXPECT_TRUE(rows.starts_with("QGC WPL 110\n0\t1\t0\t16\t"));
}

}  // namespace
}  // namespace nadir
