// Painted dots must appear in the frames where the camera model, the truth and the telemetry say: over flat ground and
// over relief, level and in banked turns, with and without distortion.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "base/csv.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/local_frame.hpp"
#include "imagery/codecs.hpp"
#include "simulation/test_world.hpp"
#include "support/temporary_folder.hpp"
#include "vision/camera_model.hpp"

namespace nadir {
namespace {

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
std::optional<cv::Point2d> spot_near(const cv::Mat& grey, const Eigen::Vector2d& pixel) {
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
        const auto position = spot_near(grey, pixel);
        ASSERT_TRUE(position) << telemetry.cell(i, 0) << " misses the dot at " << pixel.transpose();
        const double dx = position->x - pixel.x(), dy = position->y - pixel.y();
        worst = std::max(worst, std::hypot(dx, dy));
        sum_x += dx, sum_y += dy, ++dots;
      }
    }
  }
  EXPECT_GT(dots, 100);
  EXPECT_GT(degrees(steepest), 12) << "the flight must bank for this to mean anything";
  // A picture pixel is 0.24 m and a world pixel 2.1 of them: 0.1 world pixels are 0.21 picture pixels.
  EXPECT_LT(std::hypot(sum_x, sum_y) / dots, 0.1);
  EXPECT_LT(worst, 0.5);
}

TEST(FlightGeometry, DotsAppearWhereTheCameraModelSaysOverFlatGround) { expect_dots_in_place(false); }
TEST(FlightGeometry, DotsAppearWhereTheCameraModelSaysOverRelief) { expect_dots_in_place(true); }

}  // namespace
}  // namespace nadir
