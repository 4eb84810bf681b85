// nadir cache gaps as a user calls it; GDAL's ogrinfo and sqlite3 are the oracles.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "base/files.hpp"
#include "commands/command_fixture.hpp"
#include "package/package_maker.hpp"
#include "package/tile_image.hpp"
#include "support/process.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

class CacheGaps : public test::CommandTest {
 protected:
  int gaps(std::vector<std::string> args) {
    args.insert(args.begin(), {"cache", "gaps"});
    return run(std::move(args));
  }

  // GDAL's view of the file's geometries: how many, how many of them valid, and their area on the ellipsoid.
  std::vector<double> ogr(const fs::path& file) {
    const auto result = test::run_shell(
        "ogrinfo -q -dialect SQLite -sql \"SELECT count(*) AS n, sum(ST_IsValid(geometry)) AS valid, "
        "sum(ST_Area(geometry, 1)) AS area FROM '" +
        file.stem().string() + "'\" " + file.string());
    std::vector<double> numbers;
    std::istringstream lines(result.out);
    for (std::string line; std::getline(lines, line);) {
      if (const auto at = line.find(") = "); at != std::string::npos) numbers.push_back(std::stod(line.substr(at + 4)));
    }
    EXPECT_EQ(numbers.size(), 3U) << result.out << result.err;
    numbers.resize(3);
    return numbers;
  }
};

TEST_F(CacheGaps, ACompletePackageHasNone) {
  const fs::path package = maker_.make(folder_);
  EXPECT_EQ(gaps({package.string()}), 0) << out_.str() << err_.str();
  const json document = json::parse(out_.str());
  EXPECT_EQ(document["type"], "FeatureCollection");
  EXPECT_TRUE(document["features"].empty());
  EXPECT_FALSE(document.contains("crs")) << "RFC 7946 has no crs";
}

TEST_F(CacheGaps, WithoutAnyTileTheGapsAreTheMissionsArea) {
  const fs::path tiles = maker_.make(folder_) / kImageryFile;
  folder_.write("mission.yaml", test::mission_yaml());
  test::sqlite(tiles, "DELETE FROM tiles WHERE zoom_level = 18");
  EXPECT_EQ(gaps({tiles.string(), "--mission", path("mission.yaml"), "--out", path("gaps.geojson")}), 1) << err_.str();
  const auto [count, valid, area_m2] = [&] {
    const auto n = ogr(path("gaps.geojson"));
    return std::tuple(n[0], n[1], n[2]);
  }();
  EXPECT_GT(count, 4);
  EXPECT_EQ(valid, count);
  // The sector, 149.2 x 222.4 m, and of the corridor (half width 40 m, 303.6 m long) what sticks out of it: the part
  // beyond the sector's east side, 74.6 m from the start, and its round end.
  const double sector = 0.002 * 74'625.0 * 0.002 * 111'200.0;
  const double corridor = (303.5 - 75.1) * 80 + M_PI * 40 * 40 / 2;
  EXPECT_NEAR(area_m2, sector + corridor, 0.01 * (sector + corridor));
  EXPECT_NE(out_.str().find("zoom 18: "), std::string::npos);
  // the properties agree with GDAL's measurement
  std::ifstream file(path("gaps.geojson"));
  double said_m2 = 0;
  const json document = json::parse(file);
  for (const json& feature : document["features"]) said_m2 += feature["properties"]["area_m2"].get<double>();
  EXPECT_NEAR(said_m2, area_m2, 0.005 * area_m2);
}

TEST_F(CacheGaps, OneAbsentTileIsOneFeature) {
  const fs::path package = maker_.make(folder_);
  test::sqlite(package / kImageryFile,
               "DELETE FROM tiles WHERE zoom_level = 17 AND rowid = (SELECT min(rowid) FROM tiles"
               " WHERE zoom_level = 17)");
  EXPECT_EQ(gaps({package.string()}), 0) << "the finest zoom is whole";
  EXPECT_EQ(gaps({package.string(), "--zoom", "17"}), 1);
  const json document = json::parse(out_.str());
  ASSERT_EQ(document["features"].size(), 1U);
  EXPECT_EQ(document["features"][0]["properties"]["reason"], "no tile");
  EXPECT_EQ(document["features"][0]["properties"]["zoom"], 17);
}

TEST_F(CacheGaps, EmptyPixelsAreOutlinedWithTheirHoles) {
  // A chequered mask: every shape that an outline can have, corner touches included.
  maker_.edit_tile = [](Sidecar& sidecar, Bytes&) {
    if (sidecar.key.z != 18) return true;
    Bytes mask(256 * 256, 255);
    for (std::size_t row = 0; row < 256; ++row) {
      for (std::size_t column = 0; column < 256; ++column) {
        const std::size_t h = ((row / 16) * 2654435761U) ^ ((column / 16) * 40503U * 7919U);
        if ((h >> 7) % 3 != 0) mask[row * 256 + column] = 0;
      }
    }
    sidecar.valid_ppm = 333'333;
    sidecar.mask = encode_tile_mask(mask);
    return true;
  };
  const fs::path package = maker_.make(folder_);
  EXPECT_EQ(gaps({package.string(), "--out", path("gaps.geojson")}), 1) << err_.str();
  const auto numbers = ogr(path("gaps.geojson"));
  EXPECT_GT(numbers[0], 4);
  EXPECT_EQ(numbers[1], numbers[0]) << "geometries that GEOS calls invalid";
  std::ifstream file(path("gaps.geojson"));
  double said_m2 = 0;
  bool hole = false;
  const json document = json::parse(file);
  for (const json& feature : document["features"]) {
    EXPECT_EQ(feature["properties"]["reason"], "empty pixels");
    said_m2 += feature["properties"]["area_m2"].get<double>();
    const json& geometry = feature["geometry"];
    const json polygons =
        geometry["type"] == "Polygon" ? json::array({geometry["coordinates"]}) : geometry["coordinates"];
    for (const json& polygon : polygons) {
      hole = hole || polygon.size() > 1;
      for (std::size_t r = 0; r < polygon.size(); ++r) {
        double twice = 0;
        for (std::size_t i = 1; i < polygon[r].size(); ++i) {
          twice += (polygon[r][i - 1][0].get<double>() - 11) * (polygon[r][i][1].get<double>() - 48) -
                   (polygon[r][i][0].get<double>() - 11) * (polygon[r][i - 1][1].get<double>() - 48);
        }
        EXPECT_EQ(polygon[r].front(), polygon[r].back());
        EXPECT_EQ(twice > 0, r == 0) << "the right-hand rule of RFC 7946";
      }
    }
  }
  EXPECT_TRUE(hole) << "the mask should have made holes";
  EXPECT_NEAR(said_m2, numbers[2], 0.005 * said_m2);
}

TEST_F(CacheGaps, NamesMissingOptions) {
  const fs::path package = maker_.make(folder_);
  EXPECT_EQ(gaps({(package / kImageryFile).string()}), 2);
  EXPECT_NE(err_.str().find("--mission"), std::string::npos);
  EXPECT_EQ(gaps({package.string(), "--zoom", "12"}), 2);
  EXPECT_NE(err_.str().find("17 to 18"), std::string::npos) << err_.str();
  EXPECT_EQ(gaps({path("none")}), 2);
  EXPECT_EQ(gaps({package.string(), "--out", path("no/such/folder.geojson")}), 2);
  folder_.write("text.mbtiles", "no database");
  folder_.write("mission.yaml", test::mission_yaml());
  EXPECT_EQ(gaps({path("text.mbtiles"), "--mission", path("mission.yaml")}), 2);
  EXPECT_TRUE(out_.str().empty());
}

TEST_F(CacheGaps, ADamagedFileHasGapsWhereItCannotBeRead) {
  const fs::path package = maker_.make(folder_);
  test::sqlite(package / kImageryFile,
               "UPDATE tiles SET tile_data = x'00' WHERE rowid = (SELECT max(rowid) FROM tiles"
               " WHERE zoom_level = 18)");
  EXPECT_EQ(gaps({package.string()}), 1);
  EXPECT_EQ(json::parse(out_.str())["features"].size(), 1U);
}

}  // namespace
}  // namespace nadir
