#include "package_build/terrain_builder.hpp"

#include <fmt/format.h>
#include <gdal_priv.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <memory>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/random.hpp"
#include "package/mission_check.hpp"
#include "package/verify.hpp"
#include "package_build/package_builder.hpp"
#include "raster/test_raster.hpp"
#include "support/process.hpp"
#include "support/small_disk.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

// Gentle enough that bilinear interpolation over 20 m stays within millimetres.
double hills_m(double east, double north) {
  return 400 + 30 * std::sin(east / 400) + 20 * std::cos(north / 300) + 0.02 * (east - 500'000);
}

struct DemSpec {
  double step = 10;  // in units of the reference system
  int epsg = 32633;  // 0: none
  double west = 499'000, north = 5'317'500;
  int columns = 300, rows = 260;
  int bands = 1;
  GDALDataType type = GDT_Float32;
  const char* unit = "";
  double scale = 1, offset = 0;
  std::optional<double> nodata{};
};

// height: of the places where the pixels' centres lie, in the source's own system.
void write_dem(const fs::path& path, const DemSpec& spec,
               const std::function<double(double, double)>& height = hills_m) {
  GDALAllRegister();
  const std::unique_ptr<GDALDataset, void (*)(GDALDataset*)> file(
      GetGDALDriverManager()->GetDriverByName("GTiff")->Create(path.c_str(), spec.columns, spec.rows, spec.bands,
                                                               spec.type, nullptr),
      [](GDALDataset* open) { GDALClose(open); });
  ASSERT_NE(file, nullptr);
  if (spec.epsg != 0) {
    std::array<double, 6> transform{spec.west, spec.step, 0, spec.north, 0, -spec.step};
    file->SetGeoTransform(transform.data());
    OGRSpatialReference system;
    system.importFromEPSG(spec.epsg);
    file->SetSpatialRef(&system);
  }
  std::vector<double> line(static_cast<std::size_t>(spec.columns));
  for (int band = 1; band <= spec.bands; ++band) {
    GDALRasterBand* heights = file->GetRasterBand(band);
    if (*spec.unit != '\0') heights->SetUnitType(spec.unit);
    if (spec.scale != 1) heights->SetScale(spec.scale);
    if (spec.offset != 0) heights->SetOffset(spec.offset);
    if (spec.nodata) heights->SetNoDataValue(*spec.nodata);
    for (int row = 0; row < spec.rows; ++row) {
      for (int column = 0; column < spec.columns; ++column) {
        line[static_cast<std::size_t>(column)] =
            (height(spec.west + (column + 0.5) * spec.step, spec.north - (row + 0.5) * spec.step) - spec.offset) /
            spec.scale;
      }
      ASSERT_EQ(heights->RasterIO(GF_Write, 0, row, spec.columns, 1, line.data(), spec.columns, 1, GDT_Float64, 0, 0,
                                  nullptr),
                CE_None);
    }
  }
}

// 1 km around the take-off at 15° E, 48° N: x 500000, y 5316300 in UTM 33.
class TerrainBuilder : public testing::Test {
 protected:
  TerrainBuilder() { write_mission("dem"); }

  void write_mission(const std::string& mode) {
    folder_.write("mission.yaml", fmt::format(R"(schema: nadir.mission/1
id: hills
series: hills
sequence: 1
created: 2024-10-30T00:00:00Z
expires: 2024-11-30T00:00:00Z
takeoff: {{lon_deg: 15.0, lat_deg: 48.0}}
terrain: {{mode: {}}}
zoom: {{min: 14, max: 15}}
min_resolution_m: 5
budget_mb: 50
freshness_days: {{stable: 730, active: 400}}
airframes: [any]
sectors:
  - {{id: hill, class: stable, polygon: [[14.9950, 47.9970], [15.0050, 47.9970], [15.0050, 48.0030], [14.9950, 48.0030], [14.9950, 47.9970]]}}
route: {{corridor_half_width_m: 50, agl_m: 200, points: [[14.9960, 48.0], [15.0040, 48.0]]}}
)",
                                              mode));
  }

  Mission mission() const { return read_mission(folder_ / "mission.yaml"); }
  TerrainRaster cut(const std::vector<std::string>& names = {"dem.tif"}) {
    std::vector<std::filesystem::path> paths;
    for (const std::string& name : names) paths.push_back(folder_ / name);
    return cut_terrain(paths, mission());
  }

  void expect_usage_error(const std::string& word) {
    try {
      cut();
      FAIL() << "taken: " << word;
    } catch (const UsageError& error) {
      EXPECT_NE(std::string(error.what()).find(word), std::string::npos) << error.what();
    }
  }

  // What the source says at places of the mission's region: the formula that it was filled with, placed by PROJ.
  void expect_hills(const TerrainRaster& terrain, double tolerance_m) {
    Random random(9);
    for (int i = 0; i < 200; ++i) {
      const LonLat place{random.uniform(14.9945, 15.0055), random.uniform(47.9966, 48.0034)};
      const auto at = test::project(4326, "EPSG:32633", {place.lon_deg, place.lat_deg});
      const auto height = terrain.height_m(place);
      ASSERT_TRUE(height) << place.lon_deg << ' ' << place.lat_deg;
      EXPECT_NEAR(*height, hills_m(at.x, at.y), tolerance_m);
    }
  }

  PackageRequest request(const std::string& out) {
    PackageRequest request;
    request.mission = folder_ / "mission.yaml";
    request.imagery = {folder_ / "map.tif"};
    request.dem = {folder_ / "dem.tif"};
    request.key = &key_;
    request.out = folder_ / out;
    return request;
  }
  void write_map() {
    test::RasterSpec spec;
    spec.epsg = 32633;
    spec.width = spec.height = 500;
    spec.transform = {{499'000, 4, 0, 5'317'500, 0, -4}};
    test::write_raster(folder_ / "map.tif", spec, [](int column, int row) -> std::array<int, 4> {
      return {80 + (column * 7 + row * 3) % 120, 90 + row % 60, 70, 255};
    });
    test::write_item(folder_ / "map.tif", "2024-03-01T00:00:00Z", 4);
  }

  test::TemporaryFolder folder_;
  PrivateKey key_ = PrivateKey::generate();
};

TEST_F(TerrainBuilder, FromUtmTheHeightsAreThoseOfTheSource) {
  write_dem(folder_ / "dem.tif", {});
  const TerrainRaster terrain = cut();
  expect_hills(terrain, 0.01);
  EXPECT_NEAR(terrain.grid().lat_step_deg * 111'320, 10, 0.1);
  EXPECT_NEAR(terrain.grid().lon_step_deg * 111'320 * std::cos(48 * M_PI / 180), 10, 0.1);
  EXPECT_LT(terrain.grid().west_deg, 14.9950 - 0.006) << "the margin of a footprint";
  EXPECT_LT(terrain.grid().columns * 10, 800 + 2 * 500 + 100) << "and not more";
}

TEST_F(TerrainBuilder, FinerSourcesAreAveragedAndCoarserOnesStay) {
  write_dem(folder_ / "dem.tif", {.step = 2, .columns = 1500, .rows = 1300});
  EXPECT_NEAR(cut().grid().lat_step_deg * 111'320, 10, 0.1);
  expect_hills(cut(), 0.03);
  write_dem(folder_ / "dem.tif", {.step = 30, .columns = 100, .rows = 87});
  EXPECT_NEAR(cut().grid().lat_step_deg * 111'320, 30, 0.3);
  expect_hills(cut(), 0.15);
}

// Two cells of a model side by side, as they are sold, make the terrain of the one raster that they were cut from.
TEST_F(TerrainBuilder, CellsOfOneGridAreOneModel) {
  const double second = 1.0 / 3600;
  const auto rough = [](double lon, double lat) { return 300 + 40 * std::sin(lon * 900) * std::cos(lat * 700); };
  DemSpec spec{.step = second, .epsg = 4326, .west = 14.98, .north = 48.02, .columns = 150, .rows = 150};
  write_dem(folder_ / "dem.tif", spec, rough);
  spec.columns = 70;
  write_dem(folder_ / "west.tif", spec, rough);
  spec.west += 70 * second, spec.columns = 80;
  write_dem(folder_ / "east.tif", spec, rough);
  const TerrainRaster whole = cut();
  for (const auto& names : {std::vector<std::string>{"west.tif", "east.tif"}, {"east.tif", "west.tif"}}) {
    const TerrainRaster cells = cut(names);
    ASSERT_EQ(cells.grid().posts(), whole.grid().posts());
    EXPECT_NEAR(cells.grid().west_deg, whole.grid().west_deg, 1e-9);
    for (std::size_t i = 0; i < whole.heights_m().size(); ++i) ASSERT_EQ(cells.heights_m()[i], whole.heights_m()[i]);
  }
  const TerrainRaster half = cut({"west.tif"});
  EXPECT_TRUE(std::any_of(half.heights_m().begin(), half.heights_m().end(), [](float h) { return std::isnan(h); }));
}

// More cells than this process may have files open.
TEST_F(TerrainBuilder, AListOfManyModelsIsReadOneByOne) {
  constexpr int kCells = 50;
  const double second = 1.0 / 3600;
  DemSpec spec{.step = second, .epsg = 4326, .west = 14.98, .north = 48.02, .columns = 150, .rows = 150};
  write_dem(folder_ / "dem.tif", spec, [](double lon, double) { return 300 + 1000 * (lon - 15); });
  spec.columns = 150 / kCells;
  std::vector<std::string> cells;
  for (int i = 0; i < kCells; ++i) {
    cells.push_back(fmt::format("cell-{}.tif", i));
    write_dem(folder_ / cells.back(), spec, [](double lon, double) { return 300 + 1000 * (lon - 15); });
    spec.west += spec.columns * second;
  }
  const TerrainRaster whole = cut();
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &before), 0);
  const rlimit few{kCells / 2, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &few), 0);
  const auto restored = [&before](int*) { setrlimit(RLIMIT_NOFILE, &before); };
  int any = 0;
  const std::unique_ptr<int, decltype(restored)> later(&any, restored);
  const TerrainRaster joined = cut(cells);
  ASSERT_EQ(joined.grid().posts(), whole.grid().posts());
  for (std::size_t i = 0; i < whole.heights_m().size(); ++i) ASSERT_EQ(joined.heights_m()[i], whole.heights_m()[i]);
}

// A survey of the middle on top of a coarse model of everything: its posts and its heights where it has some.
TEST_F(TerrainBuilder, TheFirstModelLiesOnTopAndTheFinestGivesTheGrid) {
  write_dem(folder_ / "coarse.tif", {.step = 30, .columns = 120, .rows = 110}, [](double, double) { return 100; });
  write_dem(folder_ / "fine.tif", {.step = 10, .west = 499'900, .north = 5'316'400, .columns = 20, .rows = 20},
            [](double, double) { return 200; });
  const LonLat middle{15.0, 48.0}, beside{14.9960, 48.0};
  const TerrainRaster above = cut({"fine.tif", "coarse.tif"});
  EXPECT_NEAR(above.grid().lat_step_deg * 111'320, 10, 0.1);
  EXPECT_EQ(above.height_m(middle), 200);
  EXPECT_EQ(above.height_m(beside), 100);
  const TerrainRaster below = cut({"coarse.tif", "fine.tif"});
  EXPECT_EQ(below.height_m(middle), 100);
  EXPECT_EQ(below.grid().posts(), above.grid().posts());
}

// Steps that no other grid has: the posts of the source come over untouched.
TEST_F(TerrainBuilder, GridsOfDegreesAreCopiedPostByPost) {
  const double second = 1.0 / 3600;
  const auto rough = [](double lon, double lat) {
    return 300 + std::fmod(std::abs(lon * 7919 + lat * 104'729), 1.0) * 50;
  };
  write_dem(folder_ / "dem.tif",
            {.step = second, .epsg = 4326, .west = 14.98, .north = 48.02, .columns = 150, .rows = 150}, rough);
  const TerrainRaster terrain = cut();
  EXPECT_DOUBLE_EQ(terrain.grid().lon_step_deg, second);
  const std::string path = (folder_ / "dem.tif").string();
  std::string asked;
  std::vector<double> ours;
  for (int i = 0; i < 120; ++i) {
    const int column = (i * 37) % terrain.grid().columns, row = (i * 11) % terrain.grid().rows;
    const LonLat place = terrain.grid().place(column, row);
    asked += fmt::format("{:.12f} {:.12f}\\n", place.lon_deg, place.lat_deg);
    ours.push_back(terrain.height_m(place).value_or(-1));
  }
  std::istringstream answer(
      test::run_shell("printf '" + asked + "' | gdallocationinfo -valonly -wgs84 '" + path + "'").out);
  for (const double height : ours) {
    double expected = 0;
    ASSERT_TRUE(answer >> expected);
    EXPECT_NEAR(height, expected, 1e-4);
  }
}

TEST_F(TerrainBuilder, WrittenHeightsAreReadBackByUsAndByGdal) {
  write_dem(folder_ / "dem.tif", {.nodata = -9999},
            [](double east, double north) { return east < 499'400 ? -9999 : hills_m(east, north); });
  const TerrainRaster terrain = cut();
  write_terrain(terrain, folder_ / "out.tif");
  const TerrainRaster back = read_terrain_raster(folder_ / "out.tif");
  EXPECT_EQ(back.grid().columns, terrain.grid().columns);
  EXPECT_EQ(back.grid().west_deg, terrain.grid().west_deg);
  EXPECT_EQ(back.grid().lat_step_deg, terrain.grid().lat_step_deg);
  ASSERT_EQ(back.heights_m().size(), terrain.heights_m().size());
  std::size_t unknown = 0;
  for (std::size_t i = 0; i < back.heights_m().size(); ++i) {
    const float a = back.heights_m()[i], b = terrain.heights_m()[i];
    unknown += std::isnan(a) ? 1U : 0U;
    ASSERT_TRUE(a == b || (std::isnan(a) && std::isnan(b)));
  }
  EXPECT_GT(unknown, 0U);
  const LonLat place = terrain.grid().place(90, 60);
  const auto answer = test::run_shell(fmt::format("gdallocationinfo -valonly -wgs84 '{}' {:.12f} {:.12f}",
                                                  (folder_ / "out.tif").string(), place.lon_deg, place.lat_deg));
  EXPECT_NEAR(std::stod(answer.out), back.height_m(place).value_or(0), 1e-4);
  write_terrain(cut(), folder_ / "again.tif");
  EXPECT_EQ(read_file(folder_ / "out.tif"), read_file(folder_ / "again.tif"));
}

TEST_F(TerrainBuilder, ScaledHeightsBecomeMetres) {
  write_dem(folder_ / "dem.tif", {.type = GDT_UInt16, .unit = "m", .scale = 0.01, .offset = 200},
            [](double, double) { return 345.67; });
  EXPECT_NEAR(cut().height_m({15, 48}).value_or(0), 345.67, 0.006);
}

TEST_F(TerrainBuilder, RejectsWhatIsNoElevationModel) {
  write_dem(folder_ / "dem.tif", {.bands = 3});
  expect_usage_error("3 bands");
  write_dem(folder_ / "dem.tif", {.epsg = 0});
  expect_usage_error("georeferenced");
  write_dem(folder_ / "dem.tif", {.unit = "ft"});
  expect_usage_error("ft");
  folder_.write("dem.tif", "no raster");
  EXPECT_THROW(cut(), Error);
  fs::remove(folder_ / "dem.tif");
  EXPECT_THROW(cut(), Error);
}

TEST_F(TerrainBuilder, ATruncatedSourceIsAnError) {
  write_dem(folder_ / "dem.tif", {});
  fs::resize_file(folder_ / "dem.tif", fs::file_size(folder_ / "dem.tif") / 3);
  EXPECT_THROW(cut(), Error);
}

TEST_F(TerrainBuilder, ThePackageHoldsItAndIsReproducible) {
  write_dem(folder_ / "dem.tif", {});
  write_map();
  NoProgress progress;
  const PackageReport report = build_package(request("one"), progress);
  ASSERT_FALSE(report.findings.has_errors())
      << (report.findings.empty() ? "" : to_text(report.findings.items().front()));
  ASSERT_TRUE(report.terrain);
  const auto manifest = parse_manifest(read_file(folder_ / "one" / kManifestFile)).manifest;
  ASSERT_TRUE(manifest);
  ASSERT_NE(manifest->artifact(kRoleTerrain), nullptr);
  EXPECT_EQ(manifest->artifact(kRoleTerrain)->path, kTerrainFile);
  const TerrainReading reading = read_package_terrain(Directory(folder_ / "one"), *manifest, mission());
  ASSERT_TRUE(reading.terrain);
  expect_hills(*reading.terrain, 0.01);
  PackageRequest again = request("two");
  again.tiles.threads = 2;
  build_package(again, progress);
  EXPECT_EQ(test::run_process({"diff", "-r", (folder_ / "one").string(), (folder_ / "two").string()}).code, 0);
}

TEST_F(TerrainBuilder, GapsMissingModelsAndFlatMissionsAreRejectedWithoutLeftovers) {
  write_map();
  NoProgress progress;
  const auto expect_refused = [&](const PackageRequest& request, const char* code) {
    const PackageReport report = build_package(request, progress);
    EXPECT_TRUE(report.findings.has_errors());
    EXPECT_TRUE(report.findings.contains(code)) << code;
    EXPECT_FALSE(fs::exists(folder_ / "package"));
    EXPECT_FALSE(fs::exists(folder_ / ".package.staging"));
  };
  write_dem(folder_ / "dem.tif", {.columns = 90});  // ends 100 m west of the take-off
  expect_refused(request("package"), "dem.gap");
  write_dem(folder_ / "dem.tif", {.west = 699'000});  // another place
  expect_refused(request("package"), "dem.gap");
  write_dem(folder_ / "dem.tif", {.nodata = -1},
            [](double east, double north) { return std::hypot(east - 500'100, north - 5'316'300) < 30 ? -1 : 500; });
  expect_refused(request("package"), "dem.gap");
  write_dem(folder_ / "dem.tif", {}, [](double east, double) { return east < 499'900 ? -32'768 : 500; });
  expect_refused(request("package"), "dem.implausible");
  PackageRequest without = request("package");
  without.dem.clear();
  expect_refused(without, "dem.gap");
  write_mission("flat");
  EXPECT_THROW(build_package(request("package"), progress), UsageError);
  EXPECT_FALSE(fs::exists(folder_ / "package"));
}

// The disk has room for the tiles, and for the terrain no more: a file takes what is left right before it is written.
TEST_F(TerrainBuilder, AFullDiskAtTheTerrainLosesNothing) {
  write_dem(folder_ / "dem.tif", {}, [](double east, double north) {
    return 500 + std::fmod(std::abs(std::sin(east * 12.9898 + north * 78.233)) * 43'758.5453, 40);  // hardly packs
  });
  write_map();
  const fs::path small = folder_ / "small", filler = small / "filler";
  test::SmallDisk disk(small, "size=16m");
  if (!disk.mounted()) GTEST_SKIP() << "NOT TESTED: a full disk needs root and a tmpfs to mount";
  class FillDisk final : public Progress {
   public:
    explicit FillDisk(fs::path filler) : filler_(std::move(filler)) {}
    void begin(std::string_view label, std::uint64_t, std::string_view) override {
      if (label != "completing the package") return;
      std::ofstream(filler_, std::ios::binary) << std::string(16 << 20, 'x');  // as much as there is room for
      fs::resize_file(filler_, fs::file_size(filler_) - std::uintmax_t{8} * 4096);
    }
    void advance(std::uint64_t) override {}
    void end() override {}

   private:
    fs::path filler_;
  } fill(filler);
  NoProgress progress;
  ASSERT_FALSE(build_package(request("whole"), progress).findings.has_errors());
  ASSERT_GT(fs::file_size(folder_ / "whole" / kTerrainFile), 50'000U);

  PackageRequest wanted = request("small/package");
  wanted.resume = true;
  try {
    build_package(wanted, fill);
    ADD_FAILURE() << "written to a full disk";
  } catch (const OutOfSpace& error) {
    EXPECT_NE(error.text().where.find("dem.tif"), std::string::npos) << error.what();
    EXPECT_NE(error.text().fix.find("--resume"), std::string::npos) << error.what();
  }
  EXPECT_FALSE(fs::exists(wanted.out));
  fs::remove(filler);
  EXPECT_GT(build_package(wanted, progress).resumed, 0);
  EXPECT_EQ(test::run_process({"diff", "-r", (folder_ / "whole").string(), wanted.out.string()}).code, 0);
}

}  // namespace
}  // namespace nadir
