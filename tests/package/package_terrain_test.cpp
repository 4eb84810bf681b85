#include <gtest/gtest.h>

#include <cmath>

#include "base/files.hpp"
#include "imagery/terrain_file.hpp"
#include "package/mission_check.hpp"
#include "package/open_package.hpp"
#include "package/package_maker.hpp"

namespace nadir {
namespace {

using test::PackageMaker;
using test::TemporaryFolder;

// Covers the village and its corridor with 200 m to spare.
const TerrainGrid kGrid{10.9950, 48.0040, 0.0002, 0.0002, 70, 40};

double slope(int column, int row) { return 480 + column * 0.5 - row * 0.3; }

class PackageWithTerrain : public testing::Test {
 protected:
  PackageWithTerrain() {
    maker_.mission = test::mission_yaml({{"mode: flat", "mode: dem"}});
    maker_.edit_manifest = [this](Manifest& manifest) {
      const auto package = folder_ / "package";
      std::filesystem::create_directories(package / "terrain");
      std::filesystem::rename(test::write_terrain_file(folder_, "dem.tif", grid_, height_), package / kTerrainFile);
      manifest.artifacts.push_back(describe_file(package, kTerrainFile, kRoleTerrain));
    };
  }

  Findings verify(const std::filesystem::path& package, VerifyDepth depth = VerifyDepth::full) {
    return maker_.verify(package, depth).findings;
  }
  Opening open(const std::filesystem::path& package) {
    NoProgress progress;
    return open_package(package, maker_.options(), progress);
  }

  TemporaryFolder folder_;
  PackageMaker maker_;
  TerrainGrid grid_ = kGrid;
  std::function<double(int, int)> height_ = slope;
};

TEST_F(PackageWithTerrain, IsAcceptedAndReturnsTheTerrain) {
  const auto package = maker_.make(folder_);
  EXPECT_EQ(test::codes(verify(package)), "");
  EXPECT_EQ(test::codes(verify(package, VerifyDepth::quick)), "");
  const Opening opening = open(package);
  ASSERT_TRUE(opening.package) << test::codes(opening.findings);
  ASSERT_NE(opening.package->terrain(), nullptr);
  EXPECT_NEAR(opening.package->terrain()->height_m(kGrid.place(30, 20)).value_or(0), slope(30, 20), 1e-3);
}

TEST_F(PackageWithTerrain, RejectsAlteredHeights) {
  const auto package = maker_.make(folder_);
  Bytes bytes = read_file(package / kTerrainFile);
  bytes[bytes.size() / 2] = static_cast<std::uint8_t>(bytes[bytes.size() / 2] ^ 1);
  write_file_atomic(package / kTerrainFile, ByteView(bytes));
  EXPECT_EQ(test::codes(verify(package)), "artifact.hash");
  EXPECT_EQ(test::codes(verify(package, VerifyDepth::quick)), "") << "quick leaves the bytes to the reader";
  const Opening opening = open(package);
  EXPECT_FALSE(opening.package);
  EXPECT_EQ(test::codes(opening.findings), "artifact.hash");
}

TEST_F(PackageWithTerrain, AMissingFileIsFoundAtEveryDepth) {
  const auto package = maker_.make(folder_);
  std::filesystem::remove(package / kTerrainFile);
  EXPECT_EQ(test::codes(verify(package)), "artifact.missing");
  EXPECT_EQ(test::codes(verify(package, VerifyDepth::quick)), "artifact.missing");
  EXPECT_FALSE(open(package).package);
}

TEST_F(PackageWithTerrain, AHoleInTheRegionIsAGap) {
  height_ = [](int column, int row) { return column == 25 && row == 20 ? test::kNodata : slope(column, row); };
  const auto package = maker_.make(folder_);
  const Findings findings = verify(package);
  EXPECT_EQ(test::codes(findings), "dem.gap, dem.gap");
  EXPECT_NE(findings.items()[1].where.find("10.999"), std::string::npos) << findings.items()[1].where;
  EXPECT_FALSE(open(package).package);
}

TEST_F(PackageWithTerrain, AHoleOutsideOfTheRegionIsNoGap) {
  height_ = [](int column, int row) { return row < 10 || column < 10 ? test::kNodata : slope(column, row); };
  EXPECT_EQ(test::codes(verify(maker_.make(folder_))), "");
}

TEST_F(PackageWithTerrain, TooSmallARasterIsAGap) {
  grid_.columns = 40;  // ends at 11.003, the corridor reaches 11.0045
  EXPECT_TRUE(verify(maker_.make(folder_)).contains("dem.gap"));
}

TEST_F(PackageWithTerrain, ARasterElsewhereIsAGap) {
  grid_.west_deg = 12;
  EXPECT_TRUE(verify(maker_.make(folder_)).contains("dem.gap"));
}

TEST_F(PackageWithTerrain, RejectsImplausibleHeights) {
  height_ = [](int column, int row) { return column == 3 && row == 3 ? 32'767 : slope(column, row); };
  EXPECT_EQ(test::codes(verify(maker_.make(folder_))), "dem.implausible");
}

TEST_F(PackageWithTerrain, ReportsSignedInvalidBytes) {
  maker_.edit_manifest = [this](Manifest& manifest) {
    const auto package = folder_ / "package";
    std::filesystem::create_directories(package / "terrain");
    write_file_atomic(package / kTerrainFile, std::string_view("no heights"));
    manifest.artifacts.push_back(describe_file(package, kTerrainFile, kRoleTerrain));
  };
  const auto package = maker_.make(folder_);
  EXPECT_EQ(test::codes(verify(package)), "dem.corrupt");
  EXPECT_EQ(test::codes(open(package).findings), "dem.corrupt");
}

TEST_F(PackageWithTerrain, MissingTerrainOfADemMissionIsAGap) {
  maker_.edit_manifest = [](Manifest&) {};
  const auto package = maker_.make(folder_);
  EXPECT_EQ(test::codes(verify(package)), "dem.gap");
  EXPECT_EQ(test::codes(verify(package, VerifyDepth::quick)), "dem.gap");
}

TEST_F(PackageWithTerrain, RejectsTerrainOfAFlatMission) {
  maker_.mission = test::mission_yaml();
  EXPECT_EQ(test::codes(verify(maker_.make(folder_))), "mission.mismatch");
}

// Every quad against brute force: heights asked for on a fine grid of points inside the region.
TEST_F(PackageWithTerrain, GapsAgreeWithBruteForce) {
  const Mission mission = read_mission(folder_.write("mission.yaml", maker_.mission));
  const LocalFrame frame = mission_frame(mission);
  const Region region = required_region(mission, frame);
  for (int hole = 0; hole < 70 * 40; hole += 23) {
    std::vector<float> heights(kGrid.posts(), 500);
    heights[static_cast<std::size_t>(hole)] = std::nanf("");
    const TerrainRaster raster(kGrid, std::move(heights));
    bool gap = false;
    for (double dx = -1; dx <= 1; dx += 0.05) {
      for (double dy = -1; dy <= 1; dy += 0.05) {
        const LonLat place = kGrid.place(hole % 70 + dx, hole / 70 + dy);
        const PlanePoint enu = frame.plane_from_lonlat(place);
        // A corner of a quad that the region barely touches may fall between the samples.
        gap =
            gap || (!raster.height_m(place) && region.contains(enu) && region.contains({enu.east_m + 6, enu.north_m}) &&
                    region.contains({enu.east_m - 6, enu.north_m}) && region.contains({enu.east_m, enu.north_m + 6}) &&
                    region.contains({enu.east_m, enu.north_m - 6}));
      }
    }
    const bool reported = check_terrain(mission, raster).contains("dem.gap");
    EXPECT_TRUE(reported || !gap) << hole;
    bool touched = false;
    for (double dx = -1; dx <= 1; dx += 0.125) {
      for (double dy = -1; dy <= 1; dy += 0.125) {
        const PlanePoint enu = frame.plane_from_lonlat(kGrid.place(hole % 70 + dx, hole / 70 + dy));
        touched = touched || region.contains(enu);
      }
    }
    EXPECT_TRUE(touched || !reported) << hole;
  }
}

}  // namespace
}  // namespace nadir
