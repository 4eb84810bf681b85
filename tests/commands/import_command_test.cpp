// nadir mission import: drawings of several formats, made by hand and by ogr2ogr.
#include <gtest/gtest.h>

#include <sstream>

#include "base/files.hpp"
#include "cli/program.hpp"
#include "package/package_maker.hpp"
#include "commands/commands.hpp"
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

class MissionImport : public ::testing::Test {
 protected:
  int run(std::vector<std::string> args) {
    out_.str("");
    err_.str("");
    return run_program(nadir_text(), all_commands(), args, {out_, err_, clock_});
  }
  int import(const std::string& file, const std::vector<std::string>& more = {}) {
    std::vector<std::string> args{"mission", "import", file, "--id", "harbour-a", "--out", path("m.yaml")};
    args.insert(args.end(), more.begin(), more.end());
    return run(args);
  }
  std::string path(const char* name) const { return (folder_ / name).string(); }

  test::TemporaryFolder folder_;
  FixedClock clock_{test::kJudged};
  std::ostringstream out_, err_;
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
  EXPECT_EQ(import(folder_.write("none.geojson", collection({kArea})).string()), 2);
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

}  // namespace
}  // namespace nadir
