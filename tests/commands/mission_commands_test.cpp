// nadir mission import: drawings of several formats, made by hand and by ogr2ogr.
#include <gtest/gtest.h>
#include <cmath>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <sstream>

#include "base/files.hpp"
#include "base/random.hpp"
#include "cli/program.hpp"
#include "commands/command_fixture.hpp"
#include "commands/commands.hpp"
#include "package/package_maker.hpp"
#include "raster/test_raster.hpp"
#include "support/process.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

constexpr const char* kLine = R"({"type":"Feature","properties":{"name":"north"},"geometry":{"type":"LineString",
  "coordinates":[[11.0,48.0,500],[11.002,48.001,510],[11.002,48.001,510],[11.004,48.0005,520]]}})";
constexpr const char* kArea = R"({"type":"Feature","properties":{"name":"Old town / east"},"geometry":{"type":"Polygon",
  "coordinates":[[[10.999,47.999],[11.001,47.999],[11.001,48.001],[10.999,48.001],[10.999,47.999]]]}})";

std::string collection(const std::vector<std::string>& features) {
  std::string text = R"({"type":"FeatureCollection","features":[)";
  for (std::size_t i = 0; i < features.size(); ++i) text += (i > 0 ? "," : "") + features[i];
  return text + "]}";
}

class MissionImport : public test::CommandTest {
 protected:
  int import(const std::string& file, const std::vector<std::string>& more = {}) {
    std::vector<std::string> args{"mission", "import", file, "--id", "harbour-a", "--out", path("m.yaml")};
    args.insert(args.end(), more.begin(), more.end());
    return run(args);
  }
};

TEST_F(MissionImport, GeoJsonBecomesAValidMission) {
  ASSERT_EQ(import(folder_.write("plan.geojson", collection({kLine, kArea, kArea})).string(),
                   {"--half-width-m", "80", "--agl-m", "150"}),
            0)
      << out_.str() << err_.str();
  EXPECT_EQ(run({"mission", "check", path("m.yaml")}), 0) << out_.str();
  const Mission mission = read_mission(path("m.yaml"));
  EXPECT_EQ(mission.route.points.size(), 3U) << "the repeated point is dropped";
  EXPECT_EQ(mission.takeoff, (LonLat{11, 48}));
  EXPECT_EQ(mission.route.agl_m, 150);
  ASSERT_EQ(mission.sectors.size(), 2U);
  EXPECT_EQ(mission.sectors[0].id, "Old-town-east");
  EXPECT_EQ(mission.sectors[1].id, "Old-town-east-2");
  EXPECT_EQ(mission.created, parse_utc("2024-04-25"));
  EXPECT_EQ(import(path("plan.geojson")), 2) << "an existing file is not overwritten";
}

TEST_F(MissionImport, KmlAndOtherReferenceSystemsGiveTheSameMission) {
  folder_.write("plan.geojson", collection({kLine, kArea}));
  ASSERT_EQ(import(path("plan.geojson")), 0);
  const Mission expected = read_mission(path("m.yaml"));
  for (const char* how : {"-f KML", "-f GPKG -t_srs EPSG:32632"}) {
    fs::remove(path("m.yaml"));
    const std::string other = path(how[3] == 'K' ? "plan.kml" : "plan.gpkg");
    ASSERT_EQ(test::run_shell(std::string("ogr2ogr ") + how + " " + other + " " + path("plan.geojson")).code, 0);
    ASSERT_EQ(import(other), 0) << how << err_.str() << out_.str();
    const Mission mission = read_mission(path("m.yaml"));
    ASSERT_EQ(mission.route.points.size(), expected.route.points.size()) << how;
    for (std::size_t i = 0; i < expected.route.points.size(); ++i) {
      EXPECT_NEAR(mission.route.points[i].lon_deg, expected.route.points[i].lon_deg, 2e-7) << how;
      EXPECT_NEAR(mission.route.points[i].lat_deg, expected.route.points[i].lat_deg, 2e-7) << how;
    }
    ASSERT_EQ(mission.sectors.size(), 1U);
    EXPECT_EQ(mission.sectors[0].id, "Old-town-east");
  }
}

TEST_F(MissionImport, TheRouteMustBeUnambiguous) {
  std::string south = kLine;
  south.replace(south.find("north"), 5, "south");
  folder_.write("two.geojson", collection({kLine, south}));
  EXPECT_EQ(import(path("two.geojson")), 2);
  EXPECT_NE(err_.str().find("\"north\", \"south\""), std::string::npos) << err_.str();
  EXPECT_EQ(import(path("two.geojson"), {"--route", "west"}), 2);
  EXPECT_EQ(import(folder_.write("none.geojson", collection({})).string()), 2);
  EXPECT_NE(err_.str().find("no lines"), std::string::npos) << err_.str();
  EXPECT_EQ(import(path("two.geojson"), {"--route", "south"}), 0) << err_.str();
}

TEST_F(MissionImport, WritesNothingForAnInvalidMission) {
  std::string crossed = kArea;
  crossed.replace(crossed.find("[11.001,48.001],[10.999,48.001]"), 31, "[10.999,48.001],[11.001,48.001]");
  EXPECT_EQ(import(folder_.write("crossed.geojson", collection({kLine, crossed})).string()), 1);
  EXPECT_NE(out_.str().find("does not cross itself"), std::string::npos) << out_.str();
  std::string holed = kArea;
  holed.replace(holed.find("]]]}"), 4, "]],[[11,48],[11.0005,48],[11,48.0005],[11,48]]]}");
  EXPECT_EQ(import(folder_.write("holed.geojson", collection({kLine, holed})).string()), 2);
  EXPECT_NE(err_.str().find("Old town / east"), std::string::npos) << err_.str();
  EXPECT_EQ(import(folder_.write("text.kml", "no drawing").string()), 2);
  EXPECT_EQ(import(path("absent.kml")), 2);
  EXPECT_FALSE(fs::exists(path("m.yaml")));
}

TEST_F(MissionImport, AnAreaAloneWithABufferIsAMission) {
  ASSERT_EQ(import(folder_.write("area.geojson", collection({kArea})).string(), {"--buffer-m", "150"}), 0)
      << err_.str();
  const Mission mission = read_mission(path("m.yaml"));
  EXPECT_TRUE(mission.route.points.empty());
  ASSERT_EQ(mission.sectors.size(), 1U);
  EXPECT_EQ(mission.sectors[0].buffer_m, 150);
  ASSERT_EQ(run({"mission", "plan", path("m.yaml"), "--json"}), 0) << err_.str();
  const auto plan = nlohmann::json::parse(out_.str());
  // 149 x 222 m, 150 m around it, with round corners.
  EXPECT_NEAR(plan["needed_km2"].get<double>(), (149.2 * 222.4 + 2 * 150 * (149.2 + 222.4) + M_PI * 150 * 150) / 1e6,
              0.003);
}

TEST_F(MissionImport, ExportGoesOutAndComesBack) {
  folder_.write("mission.yaml",
                test::mission_yaml({{"points: [[11.0000",
                                     "heights: {frame: above_sea_level, m: [510, 620.25]}\n  points: [[11.0000"}}));
  const Mission mission = read_mission(path("mission.yaml"));
  for (const char* file : {"m.plan", "m.kml", "m.kmz", "m.geojson", "m.gpkg"}) {
    fs::remove(path("m.yaml"));
    ASSERT_EQ(run({"mission", "export", path("mission.yaml"), "--out", path(file)}), 0) << err_.str();
    ASSERT_EQ(run({"mission", "import", path(file), "--out", path("m.yaml")}), 0) << file << err_.str() << out_.str();
    EXPECT_EQ(read_mission(path("m.yaml")), mission) << file;
    EXPECT_EQ(run({"mission", "export", path("mission.yaml"), "--out", path(file)}), 2) << "an existing file is kept";
  }
  ASSERT_EQ(run({"mission", "export", path("mission.yaml"), "--format", "waypoints", "--out", path("m.txt")}), 0);
  EXPECT_NE(err_.str().find("left out"), std::string::npos);
  fs::remove(path("m.yaml"));
  EXPECT_EQ(run({"mission", "import", path("m.txt"), "--out", path("m.yaml")}), 2)
      << "waypoints need an id or a mission";
  ASSERT_EQ(run({"mission", "import", path("m.txt"), "--mission", path("mission.yaml"), "--out", path("m.yaml")}), 0)
      << err_.str();
  EXPECT_EQ(read_mission(path("m.yaml")), mission);
  EXPECT_EQ(run({"mission", "export", path("mission.yaml"), "--out", path("m.doc")}), 2);
}

class MissionCheckCommandLine : public test::CommandTest {
 protected:
  int check(const std::map<std::string, std::string>& replacements) {
    return run({"mission", "check", folder_.write("mission.yaml", test::mission_yaml(replacements)).string()});
  }
};

TEST_F(MissionCheckCommandLine, HeightsAreShownInFeetAndFeetAreSuspected) {
  ASSERT_EQ(check({}), 0);
  EXPECT_NE(out_.str().find("120 m (394 ft) above ground"), std::string::npos) << out_.str();
  EXPECT_EQ(out_.str().find("mission.height"), std::string::npos);
  ASSERT_EQ(check({{"agl_m: 120", "agl_m: 400"}}), 0) << "a note is no error";
  EXPECT_NE(out_.str().find("if these are feet, write 122"), std::string::npos) << out_.str();
}

TEST_F(MissionCheckCommandLine, AnExpiredMissionIsWarnedOf) {
  ASSERT_EQ(check({{"created: 2024-04-20", "created: 2023-04-20"}, {"expires: 2024-06-01", "expires: 2023-06-01"}}), 0);
  EXPECT_NE(out_.str().find("package.expired (warning)"), std::string::npos) << out_.str();
}

TEST_F(MissionCheckCommandLine, ARouteThroughANoFlyAreaIsWarnedOf) {
  const auto circle = [](const char* lat) {
    return std::string("no_fly:\n  - id: mast\n    circle: {lon_deg: 11.002, lat_deg: ") + lat +
           ", radius_m: 50}\nroute:";
  };
  ASSERT_EQ(check({{"route:", circle("48.0003")}}), 0) << out_.str();
  EXPECT_NE(out_.str().find("it enters mast"), std::string::npos) << out_.str();
  ASSERT_EQ(check({{"route:", circle("48.0100")}}), 0);
  EXPECT_EQ(out_.str().find("mission.no_fly"), std::string::npos) << out_.str();
  const std::string polygon =
      "no_fly:\n  - id: range\n    polygon: [[11.001, 48.0], [11.002, 48.0], [11.002, 48.001], [11.001, 48.001], "
      "[11.001, 48.0]]\nroute:";
  ASSERT_EQ(check({{"route:", polygon}}), 0);
  EXPECT_NE(out_.str().find("it enters range"), std::string::npos) << out_.str();
  EXPECT_EQ(check({{"route:", "no_fly:\n  - id: both\nroute:"}}), 1);
}

class CacheSignCommandLine : public test::CommandTest {};

TEST_F(CacheSignCommandLine, AKeyThatNobodyAppointedDoesNotSign) {
  const std::string package = maker_.make(folder_).string();
  ASSERT_EQ(run({"keys", "create", "--out", "@unappointed"}), 0);
  ASSERT_EQ(run({"keys", "create", "--out", "@root"}), 0);
  ASSERT_EQ(run({"keys", "create", "--out", "@planner"}), 0);
  ASSERT_EQ(run({"keys", "root", "--root-key", "@root.key.pem", "--package-signer", "@planner.pub.pem", "--expires",
                 "2030-01-01", "--out", "@1.root.json"}),
            0)
      << err_.str();
  EXPECT_EQ(run({"cache", "sign", package, "--key", "@unappointed.key.pem", "--trust", "@1.root.json"}), 2);
  EXPECT_NE(err_.str().find("does not appoint"), std::string::npos) << err_.str();
  EXPECT_EQ(run({"cache", "sign", package, "--key", "@planner.key.pem", "--trust", "@1.root.json"}), 0) << err_.str();
  EXPECT_EQ(err_.str().find("note:"), std::string::npos) << err_.str();
  EXPECT_EQ(run({"cache", "sign", package, "--key", "@unappointed.key.pem"}), 0);
  EXPECT_NE(err_.str().find("pass --trust ROOT.json"), std::string::npos) << err_.str();
}

// nadir mission plan: counts against formulas, the estimate against a real package of the same tiles.

using nlohmann::json;

class MissionPlan : public test::CommandTest {
 protected:
  int plan(const std::string& yaml, const std::vector<std::string>& more = {}) {
    std::vector<std::string> args{"mission", "plan", folder_.write("mission.yaml", yaml).string()};
    args.insert(args.end(), more.begin(), more.end());
    return run(std::move(args));
  }
  json document() const { return json::parse(out_.str()); }
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
  ASSERT_EQ(plan(yaml, {"--json", "--threads", "1"}), 0);
  const json one = document();
  ASSERT_EQ(plan(yaml, {"--json", "--threads", "4"}), 0);
  EXPECT_NEAR(document()["build_minutes"].get<double>() * 4, one["build_minutes"].get<double>(), 1e-9);
}

TEST_F(MissionPlan, WarnsWhereNoLookCanAnchor) {
  ASSERT_EQ(plan(test::mission_yaml(), {"--json"}), 0);
  EXPECT_EQ(out_.str().find("mission.unmatchable"), std::string::npos) << out_.str();
  ASSERT_EQ(plan(test::mission_yaml({{"agl_m: 120", "agl_m: 8"}}), {}), 0) << "an estimate is no verdict";
  EXPECT_NE(out_.str().find("mission.unmatchable"), std::string::npos) << out_.str();
  EXPECT_NE(out_.str().find("frames of 8 m at 8 m above ground"), std::string::npos) << out_.str();

  // By its imagery: a flat lake, and noise.
  folder_.write("camera.yaml",
                "model: pinhole\nwidth: 640\nheight: 480\nfx: 500\nfy: 500\ncx: 320\ncy: 240\ndistortion: []\n"
                "uncertainty: {heading_deg: 2, agl_relative: 0.03, tilt_deg: 0.8}\n");
  const Mission mission = *parse_mission(test::mission_yaml(), "m").mission;
  for (const bool noise : {false, true}) {
    test::RasterSpec spec;
    spec.epsg = 4326;
    spec.width = spec.height = 1400;
    spec.transform = {{mission.takeoff.lon_deg - 0.003, 1e-5, 0, mission.takeoff.lat_deg + 0.006, 0, -1e-5}};
    Random random(3);
    cv::Mat_<int> grey(200, 200);
    for (int& value : grey) value = static_cast<int>(random.uniform(20, 230));
    test::write_raster(folder_ / "map.tif", spec, [&](int column, int row) -> std::array<int, 4> {
      const int value = noise ? grey(row / 7, column / 7) : 90;
      return {value, value, value, 255};
    });
    test::write_item(folder_ / "map.tif", "2024-03-01T00:00:00Z", 0.9, "survey");
    ASSERT_EQ(plan(test::mission_yaml(), {"--imagery", path("map.tif"), "--camera", path("camera.yaml"), "--json"}), 0)
        << err_.str();
    const double share = document()["anchored_looks"];
    EXPECT_EQ(out_.str().find("mission.unmatchable") == std::string::npos, noise) << share;
    EXPECT_EQ(share > 0.5, noise) << share;
  }
}

TEST_F(MissionPlan, RejectsOtherFiles) {
  EXPECT_EQ(plan(test::mission_yaml({{"sequence: 3", "sequence: x"}})), 2);
  EXPECT_NE(err_.str().find("mission.yaml:4"), std::string::npos) << err_.str();
  EXPECT_EQ(plan(test::mission_yaml(), {"--tile-format", "gif"}), 2);
  EXPECT_TRUE(out_.str().empty());
}

}  // namespace
}  // namespace nadir
