#include "imagery/terrain_raster.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <sstream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/random.hpp"
#include "imagery/terrain_file.hpp"

namespace nadir {
namespace {

const TerrainGrid kGrid{11.0, 48.0, 0.0002, 0.0002, 50, 40};

double hills(int column, int row) { return 500 + 20 * std::sin(column * 0.3) + 15 * std::cos(row * 0.2); }

class TerrainFile : public testing::Test {
 protected:
  Bytes make(const std::vector<std::string>& options, const std::function<double(int, int)>& height = hills) {
    return read_file(test::write_terrain_file(folder_, "dem.tif", kGrid, height, options));
  }

  // The file is refused, and the message holds this word.
  void expect_refused(const Bytes& bytes, const std::string& word) {
    try {
      parse_terrain_raster(bytes, "dem.tif");
      FAIL() << "taken, though it is wrong: " << word;
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find(word), std::string::npos) << error.what();
    }
  }

  // The usual options with one replaced.
  static std::vector<std::string> with(const std::string& from, const std::string& to) {
    auto options = test::kAsPackagesHoldIt;
    std::replace(options.begin(), options.end(), from, to);
    return options;
  }

  test::TemporaryFolder folder_;
};

TEST_F(TerrainFile, ReturnsTheHeightsThatGdalReturns) {
  const auto path = test::write_terrain_file(folder_, "dem.tif", kGrid, hills);
  const TerrainRaster raster = read_terrain_raster(path);
  EXPECT_EQ(raster.grid().columns, 50);
  EXPECT_EQ(raster.grid().rows, 40);
  Random random(1);
  std::string places;
  std::vector<LonLat> asked;
  for (int i = 0; i < 150; ++i) {
    asked.push_back(kGrid.place(random.uniform(0, 49), random.uniform(0, 39)));
    places += fmt::format("{:.12f} {:.12f}\\n", asked.back().lon_deg, asked.back().lat_deg);
  }
  const auto nearest =
      test::run_shell(fmt::format("printf '{}' | gdallocationinfo -valonly -geoloc '{}'", places, path.string()));
  // It prints the pixel's own height: the nearest post's.
  std::istringstream printed(nearest.out);
  for (const LonLat& place : asked) {
    double expected = 0;
    printed >> expected;
    const auto column = std::floor(kGrid.column_of(place.lon_deg) + 0.5),
               row = std::floor(kGrid.row_of(place.lat_deg) + 0.5);
    const auto ours = raster.height_m(kGrid.place(column, row));
    ASSERT_TRUE(ours);
    EXPECT_NEAR(*ours, expected, 1e-3);
  }
}

TEST_F(TerrainFile, IsBilinearBetweenPostsAndConstantBeyondThem) {
  const TerrainRaster raster = parse_terrain_raster(make(test::kAsPackagesHoldIt), "dem.tif");
  Random random(2);
  for (int i = 0; i < 200; ++i) {
    const double column = random.uniform(0, 49), row = random.uniform(0, 39);
    const int c = static_cast<int>(column), r = static_cast<int>(row);
    const double u = column - c, v = row - r;
    const double expected = (1 - v) * ((1 - u) * hills(c, r) + u * hills(c + 1, r)) +
                            v * ((1 - u) * hills(c, r + 1) + u * hills(c + 1, r + 1));
    ASSERT_TRUE(raster.height_m(kGrid.place(column, row)));
    EXPECT_NEAR(*raster.height_m(kGrid.place(column, row)), expected, 1e-3);
  }
  EXPECT_NEAR(raster.height_m(kGrid.place(-0.4, 7)).value_or(0), hills(0, 7), 1e-3);
  EXPECT_NEAR(raster.height_m(kGrid.place(49.4, 39.4)).value_or(0), hills(49, 39), 1e-3);
  EXPECT_FALSE(raster.height_m(kGrid.place(-0.6, 7)));
  EXPECT_FALSE(raster.height_m(kGrid.place(7, 39.6)));
  EXPECT_FALSE(raster.height_m({std::nan(""), 48}));
}

TEST_F(TerrainFile, AnUnknownPostAffectsOnlyItsNeighbourhood) {
  const TerrainRaster raster = parse_terrain_raster(
      make(test::kAsPackagesHoldIt, [](int c, int r) { return c == 20 && r == 10 ? test::kNodata : hills(c, r); }),
      "dem.tif");
  EXPECT_FALSE(raster.height_m(kGrid.place(20, 10)));
  EXPECT_FALSE(raster.height_m(kGrid.place(19.1, 10.9)));
  EXPECT_TRUE(raster.height_m(kGrid.place(18.9, 10)));
  EXPECT_FALSE(raster.known(19, 9, 21, 11));
  EXPECT_TRUE(raster.known(0, 0, 19, 39));
  EXPECT_FALSE(raster.known(0, 0, 50, 39)) << "beyond the grid nothing is known";
}

TEST_F(TerrainFile, AcceptsUncompressedFiles) {
  EXPECT_NO_THROW(parse_terrain_raster(
      make({"-ot", "Float32", "-a_srs", "EPSG:4326", "-a_nodata", "-32767", "-co", "TILED=YES"}), "dem.tif"));
}

TEST_F(TerrainFile, RejectsOtherKindsOfFiles) {
  expect_refused(make(with("Float32", "Float64")), "bits per sample");
  expect_refused(make({"-ot", "Int32", "-a_srs", "EPSG:4326", "-a_nodata", "-32767", "-co", "TILED=YES"}),
                 "sample format");
  expect_refused(make(with("TILED=YES", "TILED=NO")), "tiled");
  expect_refused(make(with("EPSG:4326", "EPSG:4258")), "4326");
  expect_refused(
      make({"-ot", "Float32", "-a_srs", "EPSG:4326", "-a_nodata", "-32767", "-co", "TILED=YES", "-co", "COMPRESS=LZW"}),
      "compression");
  expect_refused(make({"-ot", "Float32", "-a_srs", "EPSG:4326", "-a_nodata", "none", "-co", "TILED=YES"}), "nodata");
  expect_refused(
      make({"-ot", "Float32", "-b", "1", "-b", "1", "-a_srs", "EPSG:4326", "-a_nodata", "-32767", "-co", "TILED=YES"}),
      "samples per pixel");
  auto off_earth = test::kAsPackagesHoldIt;
  off_earth.insert(off_earth.end(), {"-a_ullr", "170", "48", "190", "40"});
  expect_refused(make(off_earth), "180");
  auto point = test::kAsPackagesHoldIt;
  point.insert(point.end(), {"-mo", "AREA_OR_POINT=Point"});
  expect_refused(make(point), "raster type");
  expect_refused(Bytes(), "TIFF");
  expect_refused(Bytes(1000, 0x49), "TIFF");
}

TEST_F(TerrainFile, RejectsImplausibleHeights) {
  Bytes bytes = make({"-ot", "Float32", "-a_srs", "EPSG:4326", "-a_nodata", "-32767", "-co", "TILED=YES"});
  const float marked = static_cast<float>(hills(3, 0)), infinite = std::numeric_limits<float>::infinity();
  const auto* pattern = reinterpret_cast<const std::uint8_t*>(&marked);
  // The ASCII grid has six decimals: look for a value near the bits that are wanted.
  bool found = false;
  for (std::size_t i = 0; i + 4 <= bytes.size() && !found; ++i) {
    if (bytes[i + 3] != pattern[3] || bytes[i + 2] != pattern[2] || bytes[i + 1] != pattern[1]) continue;
    std::copy_n(reinterpret_cast<const std::uint8_t*>(&infinite), 4, bytes.begin() + static_cast<std::ptrdiff_t>(i));
    found = true;
  }
  ASSERT_TRUE(found);
  expect_refused(bytes, "finite");
}

// Whatever a damaged file says: heights that are finite or unknown, or an Error.
void expect_no_harm(const Bytes& bytes, std::size_t& taken) {
  try {
    const TerrainRaster raster = parse_terrain_raster(bytes, "dem.tif");
    ++taken;
    for (const float height : raster.heights_m()) ASSERT_FALSE(std::isinf(height));
    (void)raster.height_m({11.005, 47.996});
  } catch (const Error&) {
  }
}

TEST_F(TerrainFile, RejectsTruncatedFiles) {
  const Bytes whole = make(test::kAsPackagesHoldIt);
  std::size_t taken = 0;
  for (std::size_t size = 0; size < whole.size(); size += 1 + size / 200) {
    expect_no_harm(Bytes(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size)), taken);
  }
  EXPECT_EQ(taken, 0U);
}

TEST_F(TerrainFile, FlippedBytesNeverCrash) {
  for (const auto& options :
       {test::kAsPackagesHoldIt, std::vector<std::string>{"-ot", "Float32", "-a_srs", "EPSG:4326", "-a_nodata",
                                                          "-32767", "-co", "TILED=YES", "-co", "BIGTIFF=YES"}}) {
    const Bytes whole = make(options);
    std::size_t taken = 0;
    Random random(3);
    // The head, where tags and offsets are, byte by byte; then the rest at random.
    for (std::size_t i = 0; i < std::min<std::size_t>(whole.size(), 1200); ++i) {
      for (const int mask : {0x01, 0x80, 0xff}) {
        Bytes bytes = whole;
        bytes[i] = static_cast<std::uint8_t>(bytes[i] ^ mask);
        expect_no_harm(bytes, taken);
      }
    }
    for (int i = 0; i < 2000; ++i) {
      Bytes bytes = whole;
      for (int n = random.integer(1, 8); n > 0; --n) {
        bytes[static_cast<std::size_t>(random.integer(0, static_cast<int>(bytes.size()) - 1))] =
            static_cast<std::uint8_t>(random.integer(0, 255));
      }
      expect_no_harm(bytes, taken);
    }
    EXPECT_GT(taken, 0U) << "the test would not notice if every file were refused";
  }
}

TEST(TerrainGrids, RejectsImpossibleSizesBeforeAllocating) {
  EXPECT_THROW(TerrainRaster({0, 10, 1e-4, 1e-4, 20'001, 1}, std::vector<float>(20'001)), Error);
  EXPECT_THROW(TerrainRaster({0, 10, 1e-4, 1e-4, 3, 3}, std::vector<float>(8)), Error);
  EXPECT_THROW(TerrainRaster({0, 10, 0, 1e-4, 1, 1}, std::vector<float>(1)), Error);
  EXPECT_THROW(TerrainRaster({std::nan(""), 10, 1e-4, 1e-4, 1, 1}, std::vector<float>(1)), Error);
}

}  // namespace
}  // namespace nadir
