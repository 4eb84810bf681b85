#include "simulation/camera_simulation.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "base/csv.hpp"
#include "base/error.hpp"
#include "geodesy/angles.hpp"
#include "imagery/codecs.hpp"
#include "simulation/test_world.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

class LiveCameraTest : public ::testing::Test {
 protected:
  void SetUp() override {
    cv::Mat_<cv::Vec3b> image(600, 600);
    cv::RNG random(3);
    random.fill(image, cv::RNG::UNIFORM, 0, 255);
    cv::GaussianBlur(image, image, {}, 3);
    test::write_picture(path("world.tif"), image, placement_);
    cv::Mat_<float> heights(60, 60);
    for (int r = 0; r < 60; ++r) {
      for (int c = 0; c < 60; ++c) heights(r, c) = static_cast<float>(300 + 10 * std::sin(c / 9.0) * std::cos(r / 8.0));
    }
    RasterPlacement coarse = placement_;
    coarse.gsd_m = 20;
    write_heights(path("dem.tif"), heights, coarse);
    test::write_camera(path("camera.yaml"), 160, 120, 150, true);
    options_.world = path("world.tif");
    options_.dem = path("dem.tif");
    options_.camera = path("camera.yaml");
    options_.noise = SensorNoise::none;
  }
  std::filesystem::path path(const char* name) const { return folder_.path() / name; }
  LivePose over(double column, double row, double height_m) const {
    return {.unix_us = 1, .place = test::lonlat_at(placement_, column, row), .height_m = height_m};
  }

  test::TemporaryFolder folder_;
  RasterPlacement placement_ = test::test_placement(2);
  LiveCameraOptions options_;
};

TEST_F(LiveCameraTest, SeesWhatASimulatedFlightSeesFromTheSamePlaces) {
  SimulatedFlightOptions flight;
  flight.world = options_.world;
  flight.dem = options_.dem;
  flight.camera = options_.camera;
  flight.noise = SensorNoise::none;
  flight.interval_s = 4;
  std::filesystem::create_directory(path("flight"));
  NoProgress progress;
  const Mission mission = test::mission_over(placement_, {{200, 400}, {400, 400}, {400, 200}}, 120);
  simulate_flight(mission, flight, path("flight"), progress);
  const CsvTable truth = CsvTable::read(path("flight/truth.csv")),
                 measured = CsvTable::read(path("flight/telemetry.csv"));
  const LiveCamera camera(options_);
  ASSERT_GT(truth.rows(), 5U);
  for (std::size_t i = 0; i < truth.rows(); ++i) {
    const auto number = [&](const CsvTable& table, const char* name) {
      return *table.number(i, table.required_column(name));
    };
    LivePose pose;
    pose.place = {number(truth, "lon_deg"), number(truth, "lat_deg")};
    pose.height_m = number(truth, "alt_m");
    pose.attitude = {radians(number(measured, "heading_deg")), radians(number(measured, "pitch_deg")),
                     radians(number(measured, "roll_deg"))};
    const RenderedFrame shot = camera.capture(pose, i);
    EXPECT_EQ(shot.covered_fraction, 1);
    cv::Mat flown;
    const std::string name = fmt::format("flight/frames/frame_{:04}.jpg", i + 1);
    flown = read_image_file(path(name.c_str()), Colour::bgr);
    EXPECT_LT(cv::norm(shot.image, flown, cv::NORM_L1) / static_cast<double>(flown.total() * 3), 2.0) << i;
  }
}

TEST_F(LiveCameraTest, IsRepeatableAndItsNoiseIsSeeded) {
  options_.noise = SensorNoise::real;
  const LivePose pose = over(300, 300, 420);
  const cv::Mat first = LiveCamera(options_).capture(pose, 7).image;
  EXPECT_EQ(cv::norm(first, LiveCamera(options_).capture(pose, 7).image, cv::NORM_INF), 0);
  EXPECT_GT(cv::norm(first, LiveCamera(options_).capture(pose, 8).image, cv::NORM_INF), 0);
  options_.seed = 2;
  EXPECT_GT(cv::norm(first, LiveCamera(options_).capture(pose, 7).image, cv::NORM_INF), 0);
}

TEST_F(LiveCameraTest, FlatGroundLiesWhereItIsToldTo) {
  options_.dem.reset();
  options_.ground_m = 250;
  const cv::Mat at_100 = LiveCamera(options_).capture(over(300, 300, 350), 0).image;
  options_.ground_m = 0;
  const LiveCamera low(options_);
  EXPECT_LT(
      cv::norm(at_100, low.capture(over(300, 300, 100), 0).image, cv::NORM_L1) / static_cast<double>(at_100.total()),
      1.0);
  EXPECT_GT(
      cv::norm(at_100, low.capture(over(300, 300, 350), 0).image, cv::NORM_L1) / static_cast<double>(at_100.total()),
      10.0);
}

TEST_F(LiveCameraTest, AnyPoseGivesAPicture) {
  const LiveCamera camera(options_);
  const double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
  std::vector<LivePose> poses = {over(300, 300, nan),   over(300, 300, infinity), over(300, 300, 1e9),
                                 over(90000, 300, 400), {.place = {nan, 47}},     {.place = {8, 400}},
                                 {.place = {-170, -80}}};
  LivePose wild = over(300, 300, 400);
  wild.attitude.roll_rad = nan;
  poses.push_back(wild);
  for (const LivePose& pose : poses) {
    const RenderedFrame shot = camera.capture(pose, 0);
    EXPECT_EQ(shot.image.size(), cv::Size(160, 120));
    EXPECT_EQ(shot.covered_fraction, 0);
  }
  wild.attitude.roll_rad = radians(180);  // on its back: whatever it sees, it sees it without harm
  EXPECT_EQ(camera.capture(wild, 0).image.size(), cv::Size(160, 120));
  const RenderedFrame buried = camera.capture(over(300, 300, 0), 0);
  EXPECT_EQ(buried.covered_fraction, 1);
  const RenderedFrame edge = camera.capture(over(2, 300, 400), 0);
  EXPECT_GT(edge.covered_fraction, 0.3);
  EXPECT_LT(edge.covered_fraction, 0.7);
}

TEST_F(LiveCameraTest, RefusesWhatIsMissingOrNoWorld) {
  options_.world = path("nothing.tif");
  EXPECT_THROW(LiveCamera{options_}, Error);
  options_.world = path("camera.yaml");
  EXPECT_THROW(LiveCamera{options_}, Error);
  options_.world = path("world.tif");
  options_.dem = path("world.tiff");
  EXPECT_THROW(LiveCamera{options_}, Error);
}

TEST_F(LiveCameraTest, KnowsHowFarTheWorldReaches) {
  const WorldExtent extent = extent_of_world(path("world.tif"));
  const LonLat centre = test::lonlat_at(placement_, 300, 300);
  EXPECT_NEAR(extent.centre.lon_deg, centre.lon_deg, 1e-9);
  EXPECT_NEAR(extent.centre.lat_deg, centre.lat_deg, 1e-9);
  EXPECT_NEAR(extent.gsd_m, 2, 0.01);
  // The grid's north turns away from the meridian: the box is a little wider than 1200 m.
  EXPECT_NEAR(extent.box.east_m - extent.box.west_m, 1200, 12);
  EXPECT_NEAR(extent.box.north_m - extent.box.south_m, 1200, 12);
}

}  // namespace
}  // namespace nadir
