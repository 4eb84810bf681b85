#include <gtest/gtest.h>

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include "base/csv.hpp"
#include "base/error.hpp"
#include "base/files.hpp"
#include "base/sha256.hpp"
#include "geodesy/local_frame.hpp"
#include "simulation/test_world.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

class Flight : public ::testing::Test {
 protected:
  void SetUp() override {
    cv::Mat_<cv::Vec3b> image(500, 500);
    cv::RNG random(3);
    random.fill(image, cv::RNG::UNIFORM, 0, 255);
    test::write_picture(path("world.tif"), image, placement_);
    test::write_camera(path("camera.yaml"), 160, 120, 150, false);
    options_.world = path("world.tif");
    options_.camera = path("camera.yaml");
    mission_ = test::mission_over(placement_, {{150, 350}, {350, 350}, {350, 150}}, 100);
  }
  std::filesystem::path path(const char* name) const { return folder_.path() / name; }

  FlightReport fly(const char* name) {
    std::filesystem::create_directory(path(name));
    NoProgress progress;
    return simulate_flight(mission_, options_, path(name), progress);
  }
  std::string error_of_flight() {
    try {
      fly("bad");
    } catch (const Error& error) {
      return error.text().what;
    }
    return "no error";
  }

  test::TemporaryFolder folder_;
  RasterPlacement placement_ = test::test_placement(2);
  SimulatedFlightOptions options_;
  Mission mission_;
};

TEST_F(Flight, SameSeedGivesTheSameBytes) {
  const FlightReport report = fly("a");
  fly("b");
  ASSERT_GT(report.frames, 5);
  for (const char* file : {"telemetry.csv", "truth.csv", "frames/frame_0001.jpg", "frames/frame_0004.jpg"}) {
    EXPECT_EQ(sha256_file(path("a") / file), sha256_file(path("b") / file)) << file;
  }
  options_.seed = 2;
  fly("c");
  EXPECT_NE(sha256_file(path("a") / "telemetry.csv"), sha256_file(path("c") / "telemetry.csv"));
}

TEST_F(Flight, WithoutNoiseTheTelemetryIsExact) {
  options_.noise = SensorNoise::none;
  fly("exact");
  const CsvTable telemetry = CsvTable::read(path("exact/telemetry.csv")),
                 truth = CsvTable::read(path("exact/truth.csv"));
  for (std::size_t i = 0; i < telemetry.rows(); ++i) {
    EXPECT_NEAR(*telemetry.number(i, telemetry.required_column("agl_m")),
                *truth.number(i, truth.required_column("alt_m")), 2e-3);
  }
}

// Summed up twice, the exact changes of velocity lead from the start along the truth.
TEST_F(Flight, TheAccelerometerLeadsAlongTheRoute) {
  options_.noise = SensorNoise::none;
  options_.interval_s = 0.2;
  fly("imu");
  const CsvTable telemetry = CsvTable::read(path("imu/telemetry.csv")), truth = CsvTable::read(path("imu/truth.csv"));
  const auto east = telemetry.required_column("imu_dv_east_mps"), north = telemetry.required_column("imu_dv_north_mps");
  const LocalFrame frame(mission_.takeoff);
  const auto at = [&](std::size_t row) {
    const Enu enu = frame.enu_from_lonlat(
        {*truth.number(row, truth.required_column("lon_deg")), *truth.number(row, truth.required_column("lat_deg"))});
    return Eigen::Vector2d(enu.east_m, enu.north_m);
  };
  EXPECT_FALSE(telemetry.number(0, east));
  Eigen::Vector2d velocity = (at(1) - at(0)) / 0.2, place = at(0);
  for (std::size_t i = 1; i < telemetry.rows(); ++i) {
    const Eigen::Vector2d dv(*telemetry.number(i, east), *telemetry.number(i, north));
    place += 0.2 * (velocity + 0.5 * dv);
    velocity += dv;
  }
  EXPECT_LT((place - at(telemetry.rows() - 1)).norm(), 3);
}

TEST_F(Flight, FollowsTheRouteAtItsSpeedAndSpacing) {
  options_.interval_s = 1;
  options_.speed_mps = 25;
  const FlightReport report = fly("speed");
  const CsvTable truth = CsvTable::read(path("speed/truth.csv"));
  const auto lon = truth.required_column("lon_deg"), lat = truth.required_column("lat_deg");
  const LocalFrame frame(mission_.takeoff);
  const PlanePath route = to_plane(frame, mission_.route.points);
  EXPECT_NEAR(report.length_m, 25.0 * (report.frames - 1), 2.0 * report.frames);
  for (std::size_t i = 0; i < truth.rows(); ++i) {
    const Enu enu = frame.enu_from_lonlat({*truth.number(i, lon), *truth.number(i, lat)});
    EXPECT_LT(distance_to_path_m(route, {enu.east_m, enu.north_m}), 70);  // the corner is flown round
  }
}

TEST_F(Flight, RefusesWhatIsMissingTruncatedOrElsewhere) {
  const SimulatedFlightOptions good = options_;
  options_.world = path("nothing.tif");
  EXPECT_EQ(error_of_flight(), "the raster does not exist");

  options_ = good;
  options_.world = path("text.tif");
  write_file_atomic(path("text.tif"), std::string_view("this is no raster"));
  EXPECT_EQ(error_of_flight(), "the raster cannot be opened");

  const Bytes whole = read_file(good.world);
  options_.world = path("short.tif");
  write_file_atomic(path("short.tif"), ByteView(whole).first(whole.size() / 2));
  EXPECT_NE(error_of_flight(), "no error");

  options_ = good;
  mission_ = test::mission_over(placement_, {{9000, 9000}, {9200, 9000}}, 100);
  EXPECT_EQ(error_of_flight(), "the route lies outside the world");
  mission_ = test::mission_over(placement_, {{350, 350}, {700, 350}}, 100);
  EXPECT_EQ(error_of_flight(), "the route leaves the world");
}

TEST_F(Flight, RefusesAnElevationModelThatDoesNotCover) {
  RasterPlacement elsewhere = placement_;
  elsewhere.west_m += 50000;
  write_heights(path("dem.tif"), cv::Mat_<float>(40, 40, 5.F), elsewhere);
  options_.dem = path("dem.tif");
  EXPECT_EQ(error_of_flight(), "the elevation model does not cover the flight");
  // One that covers only a part of what the camera sees.
  RasterPlacement partly = placement_;
  partly.gsd_m = 10;
  write_heights(path("part.tif"), cv::Mat_<float>(100, 45, 5.F), partly);
  options_.dem = path("part.tif");
  EXPECT_EQ(error_of_flight(), "the elevation model does not cover the flight");
}

TEST_F(Flight, RefusesARasterWithoutGeoreference) {
  const char png[] =
      "\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\1\0\0\0\1\x08\2\0\0\0\x90wS\xde\0\0\0\x0cIDATx\x9c"
      "c\xf8\xcf\xc0\0\0\3\1\1\0\xc9\xfe\x92\xef\0\0\0\0IEND\xae"
      "B`\x82";
  write_file_atomic(path("plain.png"), std::string_view(png, sizeof png - 1));
  options_.world = path("plain.png");
  EXPECT_EQ(error_of_flight(), "the raster is not georeferenced");
}

}  // namespace
}  // namespace nadir
