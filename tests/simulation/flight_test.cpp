#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "base/csv.hpp"
#include "base/digest.hpp"
#include "base/error.hpp"
#include "base/files.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/local_frame.hpp"
#include "imagery/codecs.hpp"
#include "simulation/test_world.hpp"
#include "support/temporary_folder.hpp"
#include "vision/camera.hpp"
#include "vision/rolling_shutter.hpp"

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
TEST_F(Flight, TheAccelerometerIntegratesToTheRoute) {
  options_.noise = SensorNoise::none;
  options_.interval_s = 0.2;
  fly("imu");
  const CsvTable telemetry = CsvTable::read(path("imu/telemetry.csv")), truth = CsvTable::read(path("imu/truth.csv"));
  const auto east = telemetry.required_column("imu_dv_east_mps"), north = telemetry.required_column("imu_dv_north_mps");
  const LocalFrame frame(mission_.takeoff);
  const auto at = [&](std::size_t row) {
    const PlanePoint enu = frame.plane_from_lonlat(
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

// The same flight by a rolling shutter: other pictures, and what a localizer needs to undo that.
// Gyroscopes and accelerometers lead from one frame to the next: the velocity from the first stretch predicts the
// second.
TEST_F(Flight, TheInertialSamplesLeadFromFrameToFrame) {
  fly("without");
  EXPECT_FALSE(std::filesystem::exists(path("without/imu.csv")));
  options_.imu_hz = 100;
  fly("real");
  EXPECT_EQ(sha256_file(path("real/telemetry.csv")), sha256_file(path("without/telemetry.csv")));
  options_.noise = SensorNoise::none;
  fly("exact");
  const CsvTable telemetry = CsvTable::read(path("exact/telemetry.csv")),
                 truth = CsvTable::read(path("exact/truth.csv")), samples = CsvTable::read(path("exact/imu.csv"));
  EXPECT_NE(sha256_file(path("real/imu.csv")), sha256_file(path("exact/imu.csv")));
  const auto number = [](const CsvTable& table, std::size_t row, const char* column) {
    return table.required_number(row, table.required_column(column));
  };
  const LocalFrame frame(mission_.route.points.front(), number(truth, 0, "alt_m"));
  const auto place = [&](std::size_t row) {
    const PlanePoint at = frame.plane_from_lonlat({number(truth, row, "lon_deg"), number(truth, row, "lat_deg")});
    return Eigen::Vector3d(at.east_m, at.north_m, number(truth, row, "alt_m"));
  };
  const auto time = [&](std::size_t row) { return number(telemetry, row, "time_s"); };
  double worst_m = 0;
  for (std::size_t i = 1; i + 3 < telemetry.rows(); ++i) {
    const Eigen::Matrix3d camera =
        enu_from_camera({radians(number(telemetry, i, "heading_deg")), radians(number(telemetry, i, "pitch_deg")),
                         radians(number(telemetry, i, "roll_deg"))});
    Eigen::Matrix3d body;
    body << -camera.col(1), camera.col(0), camera.col(2);
    // Beyond the velocity at frame i, up to i + 1 and up to i + 2.
    Eigen::Vector3d velocity = Eigen::Vector3d::Zero(), way = Eigen::Vector3d::Zero(), way_to_next = way;
    double done_s = time(i);
    for (std::size_t k = 0; k < samples.rows() && done_s < time(i + 2); ++k) {
      const double until_s = std::min(number(samples, k, "time_s"), time(i + 2));
      if (until_s <= done_s) continue;
      const double dt = until_s - done_s;
      const Eigen::Vector3d rate(number(samples, k, "gyro_x_rad_s"), number(samples, k, "gyro_y_rad_s"),
                                 number(samples, k, "gyro_z_rad_s"));
      const Eigen::Vector3d force(number(samples, k, "accel_x_mps2"), number(samples, k, "accel_y_mps2"),
                                  number(samples, k, "accel_z_mps2"));
      const Eigen::Matrix3d half = Eigen::AngleAxisd(rate.norm() * dt / 2, rate.normalized()).toRotationMatrix();
      const Eigen::Vector3d gained = (body * half * force - Eigen::Vector3d(0, 0, 9.80665)) * dt;
      way += (velocity + gained / 2) * dt;
      velocity += gained;
      body = body * half * half;
      done_s = until_s;
      if (done_s <= time(i + 1) + 1e-9) way_to_next = way;
    }
    const double step_s = time(i + 1) - time(i);
    const Eigen::Vector3d start_mps = (place(i + 1) - place(i) - way_to_next) / step_s;
    const Eigen::Vector3d off = place(i) + 2 * step_s * start_mps + way - place(i + 2);
    worst_m = std::max(worst_m, off.head<2>().norm());
  }
  EXPECT_LT(worst_m, 0.5);
}

TEST_F(Flight, ARollingShutterIsUndoneByItsTelemetry) {
  options_.noise = SensorNoise::none;
  options_.interval_s = 0.5;
  options_.max_frames = 30;
  fly("global");
  const std::string camera_text = read_text_file(path("camera.yaml"));
  options_.camera = folder_.write("rolling.yaml", camera_text + "\nrolling_shutter: {row_time_s: 4.0e-4}\n");
  fly("rolling");
  const CameraFile camera = read_camera_file(path("rolling/camera.yaml"));
  ASSERT_TRUE(camera.readout);
  EXPECT_FALSE(CsvTable::read(path("global/telemetry.csv")).column("roll_rate_deg_s"));
  const CsvTable telemetry = CsvTable::read(path("rolling/telemetry.csv")),
                 truth = CsvTable::read(path("rolling/truth.csv"));
  const LocalFrame frame(mission_.takeoff);
  const auto angle = [&](std::size_t row, const char* column) {
    return radians(*telemetry.number(row, telemetry.required_column(column)));
  };
  const auto at = [&](std::size_t row) {
    return frame
        .plane_from_lonlat({*truth.number(row, truth.required_column("lon_deg")),
                            *truth.number(row, truth.required_column("lat_deg"))})
        .vector();
  };
  const auto picture = [&](const std::string& flight, std::size_t row) {
    const auto file = path(flight.c_str()) / "frames" / telemetry.cell(row, telemetry.required_column("frame"));
    return read_image_file(file, Colour::grey);
  };
  double rolled = 0, undone = 0;
  for (std::size_t i = 1; i + 1 < telemetry.rows(); ++i) {
    const ShutterMotion motion{
        .attitude = {angle(i, "heading_deg"), angle(i, "pitch_deg"), angle(i, "roll_deg")},
        .agl_m = *telemetry.number(i, telemetry.required_column("agl_m")),
        .velocity_mps = at(i + 1) - at(i - 1),
        .rate_rad_s = {angle(i, "roll_rate_deg_s"), angle(i, "pitch_rate_deg_s"), angle(i, "yaw_rate_deg_s")}};
    const cv::Mat global = picture("global", i), rolling = picture("rolling", i);
    rolled += cv::norm(global, rolling, cv::NORM_L1);
    undone += cv::norm(global, without_rolling_shutter(rolling, camera.camera, *camera.readout, motion), cv::NORM_L1);
  }
  EXPECT_LT(undone, 0.5 * rolled);
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
    const PlanePoint enu = frame.plane_from_lonlat({*truth.number(i, lon), *truth.number(i, lat)});
    EXPECT_LT(distance_to_path_m(route, enu), 70);  // the corner is flown round
  }
}

TEST_F(Flight, RejectsMissingTruncatedAndDistantWorlds) {
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

TEST_F(Flight, RejectsAnElevationModelThatDoesNotCoverTheRoute) {
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

TEST_F(Flight, RejectsARasterWithoutGeoreference) {
  const char png[] =
      "\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\1\0\0\0\1\x08\2\0\0\0\x90wS\xde\0\0\0\x0cIDATx\x9c"
      "c\xf8\xcf\xc0\0\0\3\1\1\0\xc9\xfe\x92\xef\0\0\0\0IEND\xae"
      "B`\x82";
  write_file_atomic(path("plain.png"), std::string_view(png, sizeof png - 1));
  options_.world = path("plain.png");
  EXPECT_EQ(error_of_flight(), "the raster is not georeferenced");
}

// Painted dots must appear in the frames where the camera model, the truth and the telemetry say: over flat ground and
// over relief, level and in banked turns, with and without distortion.

constexpr int kSide = 1600;  // pixels of 0.5 m
constexpr double kGsd = 0.5;
constexpr int kDotSpacing = 100;  // pixels

double relief_m(double column, double row) {  // of raster position, 20 m up and down
  return 300 + 20 * std::sin(column / 240) * std::cos(row / 300);
}

struct Scene {
  test::TemporaryFolder folder;
  RasterPlacement placement = test::test_placement(kGsd);

  explicit Scene(bool relief) {
    cv::Mat_<cv::Vec3b> image(kSide, kSide, cv::Vec3b(90, 90, 90));
    for (int y = kDotSpacing / 2; y < kSide; y += kDotSpacing) {
      for (int x = kDotSpacing / 2; x < kSide; x += kDotSpacing) {
        cv::circle(image, {x, y}, 3, cv::Scalar(255, 255, 255), cv::FILLED);  // centre at (x + 0.5, y + 0.5)
      }
    }
    test::write_picture(folder.path() / "world.tif", image, placement);
    test::write_camera(folder.path() / "camera.yaml", 640, 480, 500, true);
    if (!relief) return;
    RasterPlacement coarse = placement;
    coarse.gsd_m = 4;
    cv::Mat_<float> heights(kSide / 8, kSide / 8);
    for (int r = 0; r < heights.rows; ++r) {
      for (int c = 0; c < heights.cols; ++c) heights(r, c) = static_cast<float>(relief_m((c + 0.5) * 8, (r + 0.5) * 8));
    }
    write_heights(folder.path() / "dem.tif", heights, coarse);
  }

  SimulatedFlightOptions options(bool relief) const {
    SimulatedFlightOptions options;
    options.world = folder.path() / "world.tif";
    if (relief) options.dem = folder.path() / "dem.tif";
    options.camera = folder.path() / "camera.yaml";
    options.noise = SensorNoise::none;
    options.interval_s = 2;
    return options;
  }
};

// Brightness-weighted middle of a bright spot near a pixel.
std::optional<cv::Point2d> dot_near(const cv::Mat& grey, const Eigen::Vector2d& pixel) {
  const int reach = 9;
  const int x0 = static_cast<int>(std::lround(pixel.x())), y0 = static_cast<int>(std::lround(pixel.y()));
  double sum = 0, sx = 0, sy = 0;
  for (int y = y0 - reach; y <= y0 + reach; ++y) {
    for (int x = x0 - reach; x <= x0 + reach; ++x) {
      const double v = std::max(0, grey.at<std::uint8_t>(y, x) - 120);
      sum += v, sx += v * x, sy += v * y;
    }
  }
  if (sum < 200) return std::nullopt;
  return cv::Point2d(sx / sum, sy / sum);
}

void expect_dots_in_place(bool relief) {
  const Scene scene(relief);
  const auto out = scene.folder.path() / "flight";
  std::filesystem::create_directory(out);
  const Mission mission =
      test::mission_over(scene.placement, {{500, 1100}, {1050, 1080}, {1030, 500}, {520, 560}}, 120);
  NoProgress progress;
  const FlightReport report = simulate_flight(mission, scene.options(relief), out, progress);
  ASSERT_GT(report.frames, 10);

  const CameraModel camera = read_camera_file(out / "camera.yaml").camera;
  const CsvTable telemetry = CsvTable::read(out / "telemetry.csv"), truth = CsvTable::read(out / "truth.csv");
  int dots = 0;
  double worst = 0, sum_x = 0, sum_y = 0, steepest = 0;
  for (std::size_t i = 0; i < telemetry.rows(); ++i) {
    const cv::Mat grey = read_image_file(out / "frames" / telemetry.cell(i, 0), Colour::grey);
    const LonLat at{*truth.number(i, truth.required_column("lon_deg")),
                    *truth.number(i, truth.required_column("lat_deg"))};
    const LocalFrame frame(at, 0);
    const Eigen::Vector3d position(0, 0, *truth.number(i, truth.required_column("alt_m")));
    const Attitude attitude{radians(*telemetry.number(i, 3)), radians(*telemetry.number(i, 4)),
                            radians(*telemetry.number(i, 5))};
    steepest = std::max(steepest, std::abs(attitude.roll_rad));
    const Eigen::Matrix3d camera_from_enu = enu_from_camera(attitude).transpose();
    for (int y = kDotSpacing / 2; y < kSide; y += kDotSpacing) {
      for (int x = kDotSpacing / 2; x < kSide; x += kDotSpacing) {
        const double height = relief ? relief_m(x + 0.5, y + 0.5) : 0;
        const Enu dot = frame.enu_from_geodetic({test::lonlat_at(scene.placement, x + 0.5, y + 0.5), height});
        const Eigen::Vector3d seen = camera_from_enu * (Eigen::Vector3d(dot.east_m, dot.north_m, dot.up_m) - position);
        if (seen.z() < 20) continue;
        const Eigen::Vector2d pixel = camera.pixel_from_point(seen);
        if (pixel.x() < 14 || pixel.y() < 14 || pixel.x() > 625 || pixel.y() > 465) continue;
        const auto seen_dot = dot_near(grey, pixel);
        ASSERT_TRUE(seen_dot) << telemetry.cell(i, 0) << " misses the dot at " << pixel.transpose();
        const double dx = seen_dot->x - pixel.x(), dy = seen_dot->y - pixel.y();
        worst = std::max(worst, std::hypot(dx, dy));
        sum_x += dx, sum_y += dy, ++dots;
      }
    }
  }
  EXPECT_GT(dots, 100);
  EXPECT_GT(degrees(steepest), 12) << "the flight must bank for this to mean anything";
  // An image pixel is 0.24 m and a world pixel 2.1 of them: 0.1 world pixels are 0.21 image pixels.
  EXPECT_LT(std::hypot(sum_x, sum_y) / dots, 0.1);
  EXPECT_LT(worst, 0.5);
}

TEST(FlightGeometry, DotsAppearWhereTheCameraModelSaysOverFlatGround) { expect_dots_in_place(false); }
TEST(FlightGeometry, DotsAppearWhereTheCameraModelSaysOverRelief) { expect_dots_in_place(true); }

}  // namespace
}  // namespace nadir
