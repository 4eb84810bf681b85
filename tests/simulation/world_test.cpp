#include "simulation/world.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "base/digest.hpp"
#include "base/files.hpp"
#include "geodesy/region.hpp"
#include "package/mission.hpp"
#include "raster/gdal_dataset.hpp"
#include "raster/imagery_input.hpp"
#include "simulation/landscape.hpp"
#include "simulation/landscape_rendering.hpp"
#include "simulation/world_vectors.hpp"
#include "support/temporary_folder.hpp"
#include "vision/camera.hpp"

namespace nadir {
namespace {

struct MadeWorld {
  test::TemporaryFolder folder;
  WorldReport report;

  explicit MadeWorld(std::uint64_t seed) {
    NoProgress progress;
    report = make_world({.seed = seed, .size_km = 0.6, .gsd_m = 1.0}, folder.path(), progress);
  }
  cv::Mat grey(const char* name) const {
    const GdalDataset dataset(folder.path() / name);
    cv::Mat result;
    cv::cvtColor(dataset.read({0, 0, 600, 600}, {600, 600}).bgr, result, cv::COLOR_BGR2GRAY);
    return result;
  }
};

double correlation(const cv::Mat& a, const cv::Mat& b) {
  cv::Mat result;
  cv::matchTemplate(a, b, result, cv::TM_CCOEFF_NORMED);
  return static_cast<double>(result.at<float>(0, 0));
}

cv::Mat edges(const cv::Mat& grey) {
  cv::Mat smooth, x, y, strength;
  cv::GaussianBlur(grey, smooth, {}, 1.5);
  cv::Sobel(smooth, x, CV_32F, 1, 0);
  cv::Sobel(smooth, y, CV_32F, 0, 1);
  cv::magnitude(x, y, strength);
  cv::sqrt(strength, strength);
  return strength;
}

// Drawn by the borders of the fields, judged by what the painter asks of each place.
TEST(World, VectorsShowWhereWoodsAndWaterAre) {
  const double size_m = 1500;
  const Landscape land = generate_landscape(8, size_m);
  const auto as_degrees = [](GroundPoint p) { return LonLat{p.x / 1000, p.y / 1000}; };
  const nlohmann::json document = nlohmann::json::parse(world_vectors(land, as_degrees));
  std::vector<PlaneRing> woods, waters;
  std::map<std::string, int> counts;
  for (const auto& feature : document["features"]) {
    const auto property = feature["properties"].begin();
    ++counts[property.key()];
    if (property.key() != "natural") continue;
    PlaneRing ring;
    for (const auto& point : feature["geometry"]["coordinates"][0]) ring.push_back({point[0], point[1]});
    (property.value() == "wood" ? woods : waters).push_back(std::move(ring));
  }
  EXPECT_EQ(static_cast<std::size_t>(counts["waterway"]), 1U);
  EXPECT_EQ(waters.size(), 1 + land.ponds.size());
  EXPECT_GT(counts["highway"], 10);
  EXPECT_GT(counts["building"], 50);
  const auto in = [](const std::vector<PlaneRing>& rings, GroundPoint p) {
    return std::any_of(rings.begin(), rings.end(), [&](const PlaneRing& ring) {
      return contains(ring, {p.x / 1000, p.y / 1000});
    });
  };
  int wooded = 0, wet = 0;
  for (double y = 11; y < size_m; y += 17) {
    for (double x = 11; x < size_m; x += 17) {
      const GroundPoint place(x, y);
      const FieldPattern::Hit hit = land.fields.find(land.fields.uv_from_ground(place));
      const Crop crop = land.fields.parcels[static_cast<std::size_t>(hit.parcel)].crop;
      const bool wood = crop == Crop::wood || crop == Crop::conifers;
      if (hit.border_m > 1) {
        EXPECT_EQ(in(woods, place), wood) << x << " " << y;
      }
      wooded += wood ? 1 : 0;
      const double river_m = distance_m(land.river, place);
      if (river_m < 5) {
        EXPECT_TRUE(in(waters, place)) << x << " " << y;
      }
      wet += river_m < 5 ? 1 : 0;
      const bool far_from_ponds =
          std::all_of(land.ponds.begin(), land.ponds.end(), [&](const Pond& pond) { return pond.edge_m(place) > 1; });
      if (river_m > 25 && far_from_ponds) {
        EXPECT_FALSE(in(waters, place)) << x << " " << y;
      }
    }
  }
  EXPECT_GT(wooded, 50);
  EXPECT_GT(wet, 20);
}

TEST(World, SameSeedGivesTheSameBytesAndAnotherSeedAnotherWorld) {
  const MadeWorld a(5), b(5), c(6);
  for (const char* file : {"map.tif", "ground.tif", "dem.tif", "map.json", "ground.json", "mission.yaml", "camera.yaml",
                           "vectors.geojson"}) {
    EXPECT_EQ(sha256_file(a.folder.path() / file), sha256_file(b.folder.path() / file)) << file;
  }
  EXPECT_LT(std::abs(correlation(a.grey("ground.tif"), c.grey("ground.tif"))), 0.35);
}

TEST(World, MapAndDayDifferButShowTheSameWorld) {
  const MadeWorld world(5);
  const cv::Mat day = world.grey("ground.tif"), map = world.grey("map.tif");
  EXPECT_LT(correlation(day, map), 0.85) << "the map must not be a copy";
  EXPECT_GT(correlation(edges(day), edges(map)), 0.35) << "the same borders must be in both";
  EXPECT_GT(cv::norm(day, map, cv::NORM_L1) / 360000, 8);
}

TEST(World, ItsDocumentsAreAcceptedByTheirReaders) {
  const MadeWorld world(5);
  const Mission mission = read_mission(world.folder.path() / "mission.yaml");
  EXPECT_GE(mission.route.points.size(), 4U);
  const ImageryFacts facts = read_imagery_facts(world.folder.path() / "map.tif", {});
  EXPECT_LT(facts.captured_at, mission.created);
  EXPECT_DOUBLE_EQ(facts.gsd_m, 1.0);
  EXPECT_DOUBLE_EQ(facts.ce90_m, world.report.map_ce90_m);
  EXPECT_EQ(read_camera_file(world.folder.path() / "camera.yaml").camera.width, 1280);
}

TEST(World, TheMapIsMisplacedByUpToTwoMetresAndStatesIt) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    for (double x = 0; x < 2000; x += 100) {
      const double off = cv::norm(map_bias_m(seed, {x, 0.7 * x}));
      EXPECT_LT(off, 2.3);
    }
  }
}

// A piece painted alone equals the same part of a larger one: nothing depends on how the work is divided.
TEST(World, TilesOfTheWorldFitTogether) {
  const Landscape land = generate_landscape(9, 600);
  const Painter painter(land, Season::september);
  const cv::Mat_<cv::Vec3b> whole = render_view(land, painter, View::day, {1.0, 600, 100, 150, 300, 200});
  const cv::Mat_<cv::Vec3b> part = render_view(land, painter, View::day, {1.0, 600, 200, 200, 120, 80});
  EXPECT_LE(cv::norm(whole(cv::Rect(100, 50, 120, 80)), part, cv::NORM_INF), 2);
}

TEST(Landscape, WarpedPlaneInverts) {
  const Landscape land = generate_landscape(3, 800);
  for (double x = 0; x < 800; x += 90) {
    const GroundPoint position(x, 800 - 0.7 * x);
    EXPECT_LT(cv::norm(land.fields.ground_from_uv(land.fields.uv_from_ground(position)) - position), 0.01);
  }
}

TEST(Landscape, NoiseOfAGridIsTheNoiseOfItsPoints) {
  const Noise noise(42, 7.3);
  const PixelGrid grid{0.5, 300, 37, 91, 64, 48};
  cv::Mat_<float> values(grid.rows, grid.columns, 0.F);
  noise.add(grid, 2.0, values);
  for (int row = 0; row < grid.rows; row += 5) {
    for (int column = 0; column < grid.columns; ++column) {
      EXPECT_NEAR(values(row, column), 2 * noise.at(grid.x(column), grid.y(row)), 1e-5);
    }
  }
}

}  // namespace
}  // namespace nadir
