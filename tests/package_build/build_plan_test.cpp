// What is planned is what is built, and a long route costs its corridor, not its bounding box.
#include "package_build/build_plan.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "base/files.hpp"
#include "package/coverage_requirement.hpp"
#include "package/mission_check.hpp"
#include "package_build/package_builder_fixture.hpp"

namespace nadir {
namespace {

using test::PackageBuilder;

TEST_F(PackageBuilder, ThePlanCountsTheTilesThatAreBuilt) {
  // Imagery far beyond the margin.
  (*spec_.transform) = {268'000 - 560, 1.0, 0, 2'685'300 + 560, 0, -1.0};
  write_map("map.tif");
  const PackageReport report = build(request("package"));
  ASSERT_FALSE(report.findings.has_errors());
  const MissionReading reading = check_mission(folder_ / "mission.yaml");
  ASSERT_TRUE(reading.mission);
  std::uint64_t tiles = 0;
  for (const ZoomCount& count : count_whole_build(*reading.mission)) {
    tiles += count.tiles;
    const auto in_file =
        test::run_process({"sqlite3", (folder_ / "package" / kImageryFile).string(),
                           fmt::format("SELECT count(*) FROM tiles WHERE zoom_level = {}", count.zoom)});
    EXPECT_EQ(in_file.out, fmt::format("{}\n", count.tiles)) << count.zoom;
  }
  EXPECT_EQ(tiles, report.tiles);
}

Mission long_route(double lon_deg, double lat_deg) {
  Mission mission;
  mission.takeoff = {11.0, 48.0};
  mission.zoom = {14, 19};
  mission.route.corridor_half_width_m = 60;
  mission.route.agl_m = 120;
  mission.route.points = {{11.0, 48.0}, {11.0 + lon_deg / 3, 48.0 + lat_deg / 2}, {11.0 + lon_deg, 48.0 + lat_deg}};
  return mission;
}

// 300 km on a diagonal: some 40 thousand tiles of zoom 19, where the box has 9 million.
TEST(BuildPlan, ALongRouteNeedsOnlyItsCorridor) {
  const Mission mission = long_route(2.8, 1.9);
  const std::size_t tiles = required_tiles(mission, 19).size();
  EXPECT_GT(tiles, 20'000U);
  EXPECT_LT(tiles, 60'000U);
  const std::vector<ZoomCount> counts = count_whole_build(mission);
  EXPECT_EQ(counts.front().zoom, 14);
  EXPECT_EQ(counts.back().zoom, 19);
  EXPECT_LT(counts.back().tiles, 20 * tiles);  // with the margin of 250 m, in whole metatiles
  const TileRange box = wanted_range(mission);
  const std::int64_t box_tiles = (box.last_x - box.first_x + 1) * (box.last_y - box.first_y + 1);
  EXPECT_LT(counts.back().tiles, static_cast<std::uint64_t>(box_tiles) / 5);
}

// Against every tile of the bounding box.
TEST(BuildPlan, RequiredTilesEqualABruteForceTest) {
  Mission mission = long_route(0.02, 0.03);
  mission.sectors = {{"field", SectorClass::stable, {{11.03, 48.0}, {11.035, 48.004}, {11.03, 48.006}}}};
  const LocalFrame frame = mission_frame(mission);
  const CoverageRequirement need(required_region(mission, frame));
  for (int zoom = 3; zoom <= 18; ++zoom) {
    std::vector<TileKey> expected;
    const TileKey low = tile_at({10.99, 48.04}, zoom), high = tile_at({11.045, 47.99}, zoom);
    for (std::uint32_t x = low.x; x <= high.x; ++x) {
      for (std::uint32_t y = low.y; y <= high.y; ++y) {
        const TileKey key{static_cast<std::uint8_t>(zoom), x, y};
        if (need.needs(TileFootprint(frame, key))) expected.push_back(key);
      }
    }
    EXPECT_EQ(required_tiles(mission, zoom), expected) << zoom;
  }
}

TEST(BuildPlan, SwappedCoordinatesAreSuspectedWhereTheyWouldFit) {
  const auto imagery_at = [](LonLat middle) {
    ImageryInput input;
    input.path = "map.tif";
    for (const auto& [east, north] : {std::pair(-0.02, -0.02), {0.02, -0.02}, {0.02, 0.02}, {-0.02, 0.02}}) {
      input.outline.push_back(mercator_from_lonlat({middle.lon_deg + east, middle.lat_deg + north}));
    }
    return input;
  };
  const Mission mission = long_route(0.01, 0.01);  // near 11, 48
  const std::vector<ImageryInput> swapped{imagery_at({48, 11})}, far{imagery_at({30, 20})}, here{imagery_at({11, 48})};
  const Findings found = check_place(mission, swapped);
  ASSERT_EQ(found.items().size(), 1U);
  EXPECT_EQ(found.items()[0].code, "coverage.elsewhere");
  EXPECT_NE(found.items()[0].found.find("latitude and longitude swapped?"), std::string::npos)
      << found.items()[0].found;
  const Findings elsewhere = check_place(mission, far);
  ASSERT_EQ(elsewhere.items().size(), 1U);
  EXPECT_EQ(elsewhere.items()[0].found.find("swapped"), std::string::npos) << elsewhere.items()[0].found;
  EXPECT_TRUE(check_place(mission, here).empty());
}

}  // namespace
}  // namespace nadir
