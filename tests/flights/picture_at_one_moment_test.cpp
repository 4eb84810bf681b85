// A picture of a rolling shutter comes back as it would have been at one moment.
#include "flights/picture_at_one_moment.hpp"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "flights/stored_flight.hpp"
#include "geodesy/angles.hpp"
#include "imagery/codecs.hpp"
#include "support/temporary_folder.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir {
namespace {

TEST(PictureAtOneMoment, UndoesTheTurnByTheTelemetrysRates) {
  const test::TemporaryFolder folder;
  FlightDescription description = test::description(test::Course::smooth);
  CameraFile& camera = description.session.camera;
  camera.readout = SensorReadout{0.04};
  const auto attitude_at = [](double seconds) {
    return Attitude{radians(40 + 20 * seconds), radians(3 - 25 * seconds), radians(-5 + 40 * seconds)};
  };
  const auto pose_at = [&](double seconds) { return CameraPose{{10, 20}, 100, attitude_at(seconds)}; };
  const auto pose_at_row = [&](int y) {
    return pose_at(test::row_seconds(camera.camera, camera.readout->duration_s, y));
  };
  const cv::Mat read = test::photograph_moving(test::waves, camera.camera, [&](int, int y) { return pose_at_row(y); });
  Telemetry telemetry;
  telemetry.frame = "frame.png";
  telemetry.agl_m = 100;
  telemetry.heading_rad = attitude_at(0).heading_rad;
  telemetry.pitch_rad = attitude_at(0).pitch_rad;
  telemetry.roll_rad = attitude_at(0).roll_rad;
  telemetry.rate_rad_s = camera_rate(attitude_at(-1e-4), attitude_at(1e-4), 2e-4);
  const test::EncodedPicture picture{telemetry.frame, telemetry, encode_image(read, ImageFormat::png)};
  const auto store = FlightStore::create(folder / "flight", description, test::kNow, {});
  store->accept(test::offers({picture}), test::kNow);
  ASSERT_EQ(store->accepted(), 1U);

  const cv::Rect inner(24, 24, read.cols - 48, read.rows - 48);
  const cv::Mat wanted = test::photograph(test::waves, camera.camera, pose_at(0));
  const auto off = [&](const cv::Mat& image) {
    return cv::norm(image(inner), wanted(inner), cv::NORM_L1) / static_cast<double>(inner.area());
  };
  EXPECT_GT(off(read), 2);
  EXPECT_LT(off(picture_at_one_moment(*store, 0, camera, 1)), 0.35);
  // What a person clicked in the picture lies where the image has it.
  const Eigen::Vector2d clicked(60, 20), moved = pixel_at_one_moment(*store, 0, camera, clicked);
  const PlanePoint seen = test::seen_by_pixel(camera.camera, pose_at_row(20), clicked.x(), clicked.y());
  EXPECT_LT(distance_m(test::seen_by_pixel(camera.camera, pose_at(0), moved.x(), moved.y()), seen), 0.05);

  camera.readout.reset();
  EXPECT_EQ(cv::norm(picture_at_one_moment(*store, 0, camera, 1), read, cv::NORM_INF), 0);
  EXPECT_EQ(pixel_at_one_moment(*store, 0, camera, clicked), clicked);
}

}  // namespace
}  // namespace nadir
