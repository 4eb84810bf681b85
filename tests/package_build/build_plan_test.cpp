// What is planned is what is built, and a long route costs its corridor, not its bounding box.
#include "package_build/build_plan.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <map>

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

// Two slanted rasters, one of which lies over a part of the route: each tile's valid share against a sample of its
// points, be it whole inside, across an edge, or outside.
TEST(BuildPlan, ThePlannedShareOfATileIsThatOfTheOutlines) {
  Mission mission = long_route(0.02, 0.03);
  mission.zoom = {13, 17};
  const auto input_of = [](std::vector<LonLat> corners) {
    ImageryInput input{"map.tif", {UtcTime{0}, 0.5, 5, "survey"}, {}};
    for (const LonLat& corner : corners) input.outline.push_back(mercator_from_lonlat(corner));
    return input;
  };
  const std::vector<ImageryInput> inputs = {
      input_of({{10.99, 48.005}, {11.004, 48.025}, {11.012, 48.012}, {11.002, 47.995}}),
      input_of({{11.006, 48.016}, {11.016, 48.014}, {11.018, 48.021}, {11.001, 48.022}})};
  const auto contains = [](const ImageryInput& input, MercatorXY at) {
    bool inside = false;
    for (std::size_t i = 0; i < input.outline.size(); ++i) {
      const MercatorXY a = input.outline[i], b = input.outline[(i + 1) % input.outline.size()];
      if ((a.y_m > at.y_m) != (b.y_m > at.y_m) && at.x_m < a.x_m + (at.y_m - a.y_m) / (b.y_m - a.y_m) * (b.x_m - a.x_m))
        inside = !inside;
    }
    return inside;
  };
  std::map<TileKey, double> planned;
  for (const Sidecar& sidecar : plan_sidecars(mission, inputs, plan_range(mission, inputs))) {
    planned[sidecar.key] = static_cast<double>(sidecar.valid_ppm) / kWholeTile_ppm;
  }
  int whole = 0, parts = 0, none = 0;
  constexpr int kAcross = 32;
  for (int zoom = mission.zoom.min; zoom <= mission.zoom.max; ++zoom) {
    for (const TileKey& key : required_tiles(mission, zoom)) {
      const double pixel_m = mercator_pixel_m(zoom);
      int inside = 0;
      for (int i = 0; i < kAcross * kAcross; ++i) {
        const double x = (key.x + (i % kAcross + 0.5) / kAcross) * kTileSize;
        const double y = (key.y + (i / kAcross + 0.5) / kAcross) * kTileSize;
        const MercatorXY at{x * pixel_m - kMercatorHalfWorld_m, kMercatorHalfWorld_m - y * pixel_m};
        inside += contains(inputs[0], at) || contains(inputs[1], at) ? 1 : 0;
      }
      const double share = inside / static_cast<double>(kAcross * kAcross);
      EXPECT_NEAR(planned.contains(key) ? planned[key] : 0, share, 0.03) << key.z << " " << key.x << " " << key.y;
      ++(share == 1 ? whole : share == 0 ? none : parts);
    }
  }
  EXPECT_GT(whole, 10);
  EXPECT_GT(parts, 10);
  EXPECT_GT(none, 3);
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
