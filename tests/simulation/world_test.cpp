#include "simulation/world.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "base/digest.hpp"
#include "base/files.hpp"
#include "package/mission.hpp"
#include "raster/gdal_dataset.hpp"
#include "raster/imagery_input.hpp"
#include "simulation/landscape.hpp"
#include "simulation/landscape_rendering.hpp"
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

TEST(World, SameSeedGivesTheSameBytesAndAnotherSeedAnotherWorld) {
  const MadeWorld a(5), b(5), c(6);
  for (const char* file :
       {"map.tif", "ground.tif", "dem.tif", "map.json", "ground.json", "mission.yaml", "camera.yaml"}) {
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
