// The matchability map: which cells it has, that threads do not matter, what it says of a route, and what GDAL reads
// from its GeoTIFF.
#include "package_build/matchability_survey.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/random.hpp"
#include "imagery/codecs.hpp"
#include "support/process.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

constexpr int kZoom = 17;
constexpr LonLat kOrigin{11.0, 48.0};

// Roofs at random places west of the origin, calm water east of it.
class HalfWater final : public TileSource {
 public:
  ZoomRange zooms() const override { return {kZoom, kZoom}; }
  std::optional<Bytes> read(const TileKey& key) const override {
    const double shore = pixel_from_lonlat(kOrigin, kZoom).x;
    cv::Mat tile(kTileSize, kTileSize, CV_8UC3, cv::Scalar(90, 110, 100));
    Random random = Random(5).fork("tile", (std::uint64_t{key.x} << 32U) | key.y);
    for (int i = 0; i < 60; ++i) {
      const cv::RotatedRect roof(
          cv::Point2f(static_cast<float>(random.uniform(10, 246)), static_cast<float>(random.uniform(10, 246))),
          cv::Size2f(static_cast<float>(random.uniform(6, 20)), static_cast<float>(random.uniform(5, 12))),
          static_cast<float>(random.uniform(0, 180)));
      cv::Point2f corners[4];
      roof.points(corners);
      const std::vector<cv::Point> outline(corners, corners + 4);
      cv::fillConvexPoly(tile, outline, cv::Scalar::all(random.uniform(30, 230)));
    }
    const int water = static_cast<int>(std::clamp(shore - static_cast<double>(key.x) * kTileSize, 0.0, 256.0));
    tile(cv::Rect(water, 0, kTileSize - water, kTileSize)).setTo(cv::Scalar(80, 60, 40));
    return encode_image(tile, ImageFormat::png);
  }
};

struct Surveyed {
  LocalFrame frame{kOrigin};
  Region region;
  HalfWater tiles;
  NoProgress progress;

  Surveyed() {
    region.rings.push_back({{-400, -100}, {400, -100}, {400, 100}, {-400, 100}});
    region.corridors.push_back({{{-400, 300}, {400, 300}}, 4});  // far thinner than a cell
  }
  MatchabilityMap map(int threads = 2, double step_m = 80) {
    MatchabilityOptions options;
    options.footprint_m = 100;
    options.gsd_m = 1;
    options.radius_m = 80;
    options.limits = {.good_ratio = 0.8, .weak_ratio = 0.9, .min_score = 0.16, .min_valid = 0.6};
    return survey_matchability(tiles, region, frame, kZoom, step_m, options, threads, progress);
  }
};

// Made once: it is what takes time.
const MatchabilityMap& made_map() {
  static const MatchabilityMap map = Surveyed().map();
  return map;
}

TEST(MatchabilitySurvey, TheGridIsAlignedToTheWorldsPixelsAndCoversTheRegion) {
  Surveyed world;
  const MatchabilityMap& map = made_map();
  EXPECT_EQ(map.grid.step_px, 100) << "80 m of 0.799 m pixels";
  ASSERT_EQ(map.cells.size(), map.grid.cells());
  std::size_t needed = 0;
  for (int row = 0; row < map.grid.rows; ++row) {
    for (int column = 0; column < map.grid.columns; ++column) {
      const GlobalPixel corner = pixel_from_lonlat(map.grid.lonlat_at(column, row), kZoom);
      EXPECT_NEAR(std::remainder(corner.x, 100.0), 0, 1e-4);
      EXPECT_NEAR(std::remainder(corner.y, 100.0), 0, 1e-4);
      // Any of many places in the cell: an oracle denser than the code's own.
      bool inside = false, well_inside = false;
      for (int i = 0; i < 400; ++i) {
        const PlanePoint e =
            world.frame.plane_from_lonlat(map.grid.lonlat_at(column + (i % 20 + 0.5) / 20, row + (i / 20 + 0.5) / 20));
        inside = inside || world.region.contains({e.east_m, e.north_m});
        well_inside = well_inside || (std::abs(e.east_m) < 380 && std::abs(e.north_m) < 80);
      }
      const bool asked = map.at(map.grid.lonlat_at(column + 0.5, row + 0.5)) != nullptr;
      EXPECT_TRUE(inside || !asked) << column << " " << row;
      EXPECT_TRUE(asked || !well_inside) << column << " " << row;
      needed += asked ? 1U : 0U;
    }
  }
  EXPECT_GT(needed, 30U);
  EXPECT_EQ(map.at({kOrigin.lon_deg + 0.1, kOrigin.lat_deg}), nullptr);
  EXPECT_EQ(map.at({kOrigin.lon_deg, kOrigin.lat_deg + 0.0018}), nullptr) << "between the sector and the corridor";
}

TEST(MatchabilitySurvey, EveryCellOfANarrowCorridorIsProbed) {
  Surveyed world;
  const MatchabilityMap& map = made_map();
  for (double east = -395; east <= 395; east += 5) {
    EXPECT_NE(map.at(world.frame.lonlat_from_plane({east, 300})), nullptr) << east;
  }
}

TEST(MatchabilitySurvey, RoofsAreGoodWaterIsPoorForAnyNumberOfThreads) {
  Surveyed world;
  const MatchabilityMap& map = made_map();
  EXPECT_EQ(map.cells, world.map(1).cells);
  for (double east = -300; east <= -100; east += 50) {
    EXPECT_EQ(map.at(world.frame.lonlat_from_plane({east, 0}))->cls, MatchClass::good) << east;
  }
  for (double east = 100; east <= 300; east += 50) {
    EXPECT_EQ(map.at(world.frame.lonlat_from_plane({east, 0}))->cls, MatchClass::poor) << east;
  }
}

TEST(MatchabilitySurvey, SummarizesSectionsWithoutGoodMatches) {
  Surveyed world;
  const MatchabilityMap& map = made_map();
  const std::vector<LonLat> route{world.frame.lonlat_from_plane({-350, 0}), world.frame.lonlat_from_plane({350, 0})};
  const MatchabilitySummary summary = summarize_matchability(map, route, world.frame);
  EXPECT_NEAR(summary.route_length_m(), 700, 0.1);
  ASSERT_EQ(summary.without_good.size(), 1U);
  const RouteSection& stretch = summary.without_good.front();
  EXPECT_NEAR(stretch.begin_m + stretch.length_m, 700, 0.1) << "water to the end";
  EXPECT_NEAR(stretch.length_m, 350, 90) << "from the shore on, to a cell";
  const PlanePoint from = world.frame.plane_from_lonlat(stretch.from);
  EXPECT_NEAR(from.east_m, stretch.begin_m - 350, 0.1);
  EXPECT_NEAR(summary.share(MatchClass::good) + summary.share(MatchClass::weak) + summary.share(MatchClass::poor), 1,
              1e-9);
  EXPECT_NEAR(summary.route_share(MatchClass::good), 1 - stretch.length_m / 700, 1e-6);

  // Beyond the map matchability is unknown, which does not count as good.
  const MatchabilitySummary away = summarize_matchability(map, {{12, 48}, {12.01, 48}}, world.frame);
  EXPECT_NEAR(away.route_share(MatchClass::outside), 1, 1e-9);
  ASSERT_EQ(away.without_good.size(), 1U);
  EXPECT_EQ(summarize_matchability(map, {}, world.frame).without_good.size(), 0U);
}

TEST(MatchabilitySurvey, AStepWithTooManyCellsIsRejected) {
  Surveyed world;
  world.region.rings.push_back({{-40e3, -40e3}, {40e3, -40e3}, {40e3, 40e3}, {-40e3, 40e3}});
  EXPECT_THROW(world.map(1, 5), UsageError);
}

TEST(MatchabilitySurvey, GdalReadsTheSameFromTheGeoTiff) {
  Surveyed world;
  const MatchabilityMap& map = made_map();
  const test::TemporaryFolder folder;
  const auto path = folder / "matchability.tif";
  write_matchability_tiff(map, path);
  const std::string bytes = read_text_file(path);
  write_matchability_tiff(map, path);
  EXPECT_EQ(bytes, read_text_file(path)) << "the same map, other bytes";

  const auto info = test::run_process({"gdalinfo", "-json", path.string()});
  ASSERT_EQ(info.code, 0) << info.err;
  const auto document = nlohmann::json::parse(info.out);
  ASSERT_EQ(document["bands"].size(), 6U);
  const std::vector<std::string> names{"ratio", "entropy", "texture", "class", "score", "valid"};
  for (std::size_t i = 0; i < names.size(); ++i) {
    EXPECT_EQ(document["bands"][i]["description"], names[i]);
    EXPECT_EQ(document["bands"][i]["noDataValue"], -1.0);
    EXPECT_EQ(document["bands"][i]["type"], "Float32");
  }
  EXPECT_NE(document["coordinateSystem"]["wkt"].get<std::string>().find("3857"), std::string::npos);
  // Values at places, found by GDAL through its own projection.
  for (const auto& [east, expected] : {std::pair{-200.0, "1"}, std::pair{200.0, "3"}}) {
    const LonLat place = world.frame.lonlat_from_plane({east, 0});
    const auto value = test::run_process({"gdallocationinfo", "-valonly", "-b", "4", "-b", "1", "-wgs84", path.string(),
                                          fmt::format("{:.9f}", place.lon_deg), fmt::format("{:.9f}", place.lat_deg)});
    ASSERT_EQ(value.code, 0) << value.err;
    std::istringstream lines(value.out);
    std::string cls, ratio;
    std::getline(lines, cls);
    std::getline(lines, ratio);
    EXPECT_EQ(cls, expected);
    EXPECT_NEAR(std::stod(ratio), map.at(place)->ratio, 1e-5);
  }
  const LonLat between = world.frame.lonlat_from_plane({0, 200});
  const auto blank_image =
      test::run_process({"gdallocationinfo", "-valonly", "-b", "1", "-wgs84", path.string(),
                         fmt::format("{:.9f}", between.lon_deg), fmt::format("{:.9f}", between.lat_deg)});
  EXPECT_EQ(blank_image.out, "-1\n");

  EXPECT_THROW(write_matchability_tiff(map, folder / "no" / "folder.tif"), Error);
}

// A flight reads what the survey wrote, and nothing that is cut off, altered or another picture.
TEST(MatchabilitySurvey, AFlightReadsTheSameFromTheGeoTiff) {
  const MatchabilityMap& map = made_map();
  const test::TemporaryFolder folder;
  const auto path = folder / "matchability.tif";
  write_matchability_tiff(map, path);
  const Bytes bytes = read_file(path);
  const MatchabilityRaster raster = parse_matchability_raster(bytes, "map");
  ASSERT_EQ(raster.cells().columns, map.grid.columns);
  ASSERT_EQ(raster.cells().rows, map.grid.rows);
  for (int row = -1; row <= map.grid.rows; ++row) {
    for (int column = -1; column <= map.grid.columns; ++column) {
      const LonLat place = map.grid.lonlat_at(column + 0.3, row + 0.6);
      const PlaceMatchability* cell = map.at(place);
      EXPECT_EQ(raster.at(place), cell == nullptr ? MatchClass::outside : cell->cls) << column << " " << row;
    }
  }
  for (std::size_t size = 0; size < bytes.size() / 2; size += 97) {  // the last bands are not read
    EXPECT_THROW(parse_matchability_raster(ByteView(bytes).first(size), "cut"), Error) << size;
  }
  const auto converted = [&](std::vector<std::string> options) {
    const auto other = folder / "other.tif";
    std::vector<std::string> command{"gdal_translate", "-q"};
    command.insert(command.end(), options.begin(), options.end());
    command.insert(command.end(), {path.string(), other.string()});
    EXPECT_EQ(test::run_process(command).code, 0);
    return read_file(other);
  };
  EXPECT_EQ(parse_matchability_raster(converted({"-co", "INTERLEAVE=BAND"}), "plain").cells().classes,
            raster.cells().classes);
  for (const std::vector<std::string>& options : {std::vector<std::string>{"-b", "4"},
                                                  {"-co", "INTERLEAVE=PIXEL"},
                                                  {"-co", "INTERLEAVE=BAND", "-ot", "Float64"},
                                                  {"-co", "INTERLEAVE=BAND", "-co", "TILED=YES"},
                                                  {"-co", "INTERLEAVE=BAND", "-a_srs", "EPSG:32632"},
                                                  {"-co", "INTERLEAVE=BAND", "-scale_4", "0", "3", "0", "2"}}) {
    EXPECT_THROW(parse_matchability_raster(converted(options), "other"), Error) << options.back();
  }
}

}  // namespace
}  // namespace nadir
