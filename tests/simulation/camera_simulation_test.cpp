#include "simulation/camera_simulation.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <fstream>
#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <set>
#include <sstream>

#include "base/csv.hpp"
#include "base/error.hpp"
#include "base/files.hpp"
#include "geodesy/angles.hpp"
#include "imagery/codecs.hpp"
#include "simulation/frame_sink.hpp"
#include "simulation/test_world.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

constexpr std::int64_t kStart_us = 1'750'000'000'000'000;

// Gives one pose after the other, and then none.
class Script final : public PoseSource {
 public:
  explicit Script(std::vector<LivePose> poses) : poses_(std::move(poses)) {}
  std::optional<LivePose> latest(std::chrono::milliseconds) override {
    if (next_ == poses_.size()) return {};
    return poses_[next_++];
  }

 private:
  std::vector<LivePose> poses_;
  std::size_t next_ = 0;
};

class RecordingSink final : public FrameSink {
 public:
  void put(ByteView jpeg, std::int64_t unix_us) override {
    times_us.push_back(unix_us);
    last.assign(jpeg.begin(), jpeg.end());
  }
  std::vector<std::int64_t> times_us;
  Bytes last;
};

class CameraSimulation : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new test::TemporaryFolder;
    cv::Mat_<cv::Vec3b> image(100, 100, cv::Vec3b(80, 90, 100));
    test::write_picture(folder_->path() / "world.tif", image, placement());
    test::write_camera(folder_->path() / "camera.yaml", 64, 48, 60, false);
    LiveCameraOptions options;
    options.world = folder_->path() / "world.tif";
    options.camera = folder_->path() / "camera.yaml";
    camera_ = new LiveCamera(options);
  }
  static void TearDownTestSuite() {
    delete camera_;
    delete folder_;
  }
  static RasterPlacement placement() { return test::test_placement(5); }

  // Poses every 20 ms.
  static std::vector<LivePose> flight(int count, std::int64_t from_us = kStart_us) {
    std::vector<LivePose> poses;
    for (int i = 0; i < count; ++i) {
      poses.push_back(
          {.unix_us = from_us + i * 20'000, .place = test::lonlat_at(placement(), 50, 50), .height_m = 100});
    }
    return poses;
  }
  CameraSimulationReport capture(std::vector<LivePose> poses) {
    Script script(std::move(poses));
    return run_camera_simulation(*camera_, script, kept_, options_, [] { return false; });
  }

  static inline test::TemporaryFolder* folder_ = nullptr;
  static inline LiveCamera* camera_ = nullptr;
  RecordingSink kept_;
  CameraSimulationOptions options_{.pose_timeout = std::chrono::milliseconds(1)};
};

TEST_F(CameraSimulation, TakesFramesAtTheRateInThePosesTime) {
  const CameraSimulationReport report = capture(flight(501));
  EXPECT_EQ(report.end, CameraSimulationEnd::no_poses);
  EXPECT_EQ(report.frames, 51);
  EXPECT_EQ(report.frames_missed, 0);
  EXPECT_DOUBLE_EQ(report.seconds, 10);
  for (std::size_t i = 0; i < kept_.times_us.size(); ++i) {
    EXPECT_EQ(kept_.times_us[i], kStart_us + static_cast<std::int64_t>(i) * 200'000);
  }
  EXPECT_EQ(decode_image(kept_.last, Colour::bgr, "frame").image.size(), cv::Size(64, 48));
}

TEST_F(CameraSimulation, MissedFramesAreCountedAndNotMadeUpFor) {
  std::vector<LivePose> poses = flight(11);
  const std::vector<LivePose> later = flight(6, kStart_us + 1'050'000);
  poses.insert(poses.end(), later.begin(), later.end());
  const CameraSimulationReport report = capture(poses);
  const std::vector<std::int64_t> expected = {kStart_us, kStart_us + 200'000, kStart_us + 1'050'000};
  EXPECT_EQ(kept_.times_us, expected);
  EXPECT_EQ(report.frames_missed, 3);  // 0.4, 0.6 and 0.8 s
}

TEST_F(CameraSimulation, AfterALateFrameTheNextKeepsItsDistance) {
  std::vector<LivePose> poses = flight(1);
  const std::vector<LivePose> later = flight(10, kStart_us + 390'000);  // due at 0.2
  poses.insert(poses.end(), later.begin(), later.end());
  capture(poses);
  const std::vector<std::int64_t> expected = {kStart_us, kStart_us + 390'000, kStart_us + 490'000};
  EXPECT_EQ(kept_.times_us, expected);
}

TEST_F(CameraSimulation, EndsByFrameCountDurationTimeoutOrStop) {
  options_.max_frames = 3;
  EXPECT_EQ(capture(flight(500)).end, CameraSimulationEnd::all_frames);
  EXPECT_EQ(kept_.times_us.size(), 3U);
  options_.max_frames.reset();
  options_.seconds = 1.5;
  const CameraSimulationReport report = capture(flight(500));
  EXPECT_EQ(report.end, CameraSimulationEnd::all_frames);
  EXPECT_DOUBLE_EQ(report.seconds, 1.6);
  int asked = 0;
  Script script(flight(500));
  EXPECT_EQ(run_camera_simulation(*camera_, script, kept_, {}, [&] { return ++asked > 30; }).end,
            CameraSimulationEnd::stopped);
}

TEST_F(CameraSimulation, WaitsForUndeliveredFrames) {
  options_.delay = std::chrono::milliseconds(30);
  EXPECT_EQ(capture(flight(51)).frames, 6);
  EXPECT_EQ(kept_.times_us.size(), 6U);
}

TEST_F(CameraSimulation, DropsWaitingFramesWhenStopped) {
  options_.delay = std::chrono::hours(1);
  int asked = 0;
  Script script(flight(500));
  EXPECT_EQ(run_camera_simulation(*camera_, script, kept_, options_, [&] { return ++asked > 30; }).frames, 0);
  EXPECT_TRUE(kept_.times_us.empty());
}

TEST_F(CameraSimulation, ContinuesWhenTheClockIsSet) {
  std::vector<LivePose> poses = flight(11);
  for (const std::int64_t step_us : {3'600'000'000LL, -7'200'000'000LL}) {
    const std::vector<LivePose> more = flight(11, kStart_us + step_us);
    poses.insert(poses.end(), more.begin(), more.end());
  }
  const CameraSimulationReport report = capture(poses);
  EXPECT_EQ(report.frames, 6);
  EXPECT_EQ(report.frames_missed, 0);
}

TEST_F(CameraSimulation, CountsFramesBeyondTheWorld) {
  std::vector<LivePose> poses = flight(21);
  for (LivePose& pose : poses) pose.place = test::lonlat_at(placement(), 1, 50);
  EXPECT_EQ(capture(poses).frames_beyond_world, 3);
}

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

TEST_F(LiveCameraTest, RendersTheFramesOfASimulatedFlight) {
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

TEST_F(LiveCameraTest, FlatGroundHasTheGivenHeight) {
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

TEST_F(LiveCameraTest, AnyPoseGivesAFrame) {
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

TEST_F(LiveCameraTest, RejectsMissingAndInvalidWorlds) {
  options_.world = path("nothing.tif");
  EXPECT_THROW(LiveCamera{options_}, Error);
  options_.world = path("camera.yaml");
  EXPECT_THROW(LiveCamera{options_}, Error);
  options_.world = path("world.tif");
  options_.dem = path("world.tiff");
  EXPECT_THROW(LiveCamera{options_}, Error);
}

TEST_F(LiveCameraTest, MeasuresTheExtentOfTheWorld) {
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
