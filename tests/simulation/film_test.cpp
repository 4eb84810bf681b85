#include "simulation/camera_simulation.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <opencv2/core.hpp>
#include <set>
#include <sstream>

#include "base/error.hpp"
#include "base/files.hpp"
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

class Kept final : public FrameSink {
 public:
  void put(ByteView jpeg, std::int64_t unix_us) override {
    times_us.push_back(unix_us);
    last.assign(jpeg.begin(), jpeg.end());
  }
  std::vector<std::int64_t> times_us;
  Bytes last;
};

class Film : public ::testing::Test {
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
  Kept kept_;
  CameraSimulationOptions options_{.pose_timeout = std::chrono::milliseconds(1)};
};

TEST_F(Film, TakesFramesAtTheRateOfThePosesTime) {
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

TEST_F(Film, WhatWasMissedIsCountedAndNotMadeUpFor) {
  std::vector<LivePose> poses = flight(11);
  const std::vector<LivePose> later = flight(6, kStart_us + 1'050'000);
  poses.insert(poses.end(), later.begin(), later.end());
  const CameraSimulationReport report = capture(poses);
  const std::vector<std::int64_t> expected = {kStart_us, kStart_us + 200'000, kStart_us + 1'050'000};
  EXPECT_EQ(kept_.times_us, expected);
  EXPECT_EQ(report.frames_missed, 3);  // 0.4, 0.6 and 0.8 s
}

TEST_F(Film, AfterALateFrameTheNextKeepsItsDistance) {
  std::vector<LivePose> poses = flight(1);
  const std::vector<LivePose> later = flight(10, kStart_us + 390'000);  // due at 0.2
  poses.insert(poses.end(), later.begin(), later.end());
  capture(poses);
  const std::vector<std::int64_t> expected = {kStart_us, kStart_us + 390'000, kStart_us + 490'000};
  EXPECT_EQ(kept_.times_us, expected);
}

TEST_F(Film, EndsWithTheNumberTheTimeOrTheWord) {
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

TEST_F(Film, WaitsForWhatIsNotYetHandedOn) {
  options_.delay = std::chrono::milliseconds(30);
  EXPECT_EQ(capture(flight(51)).frames, 6);
  EXPECT_EQ(kept_.times_us.size(), 6U);
}

TEST_F(Film, WhatWaitsWhenItIsStoppedIsDropped) {
  options_.delay = std::chrono::hours(1);
  int asked = 0;
  Script script(flight(500));
  EXPECT_EQ(run_camera_simulation(*camera_, script, kept_, options_, [&] { return ++asked > 30; }).frames, 0);
  EXPECT_TRUE(kept_.times_us.empty());
}

TEST_F(Film, GoesOnWhenTheClockIsSet) {
  std::vector<LivePose> poses = flight(11);
  for (const std::int64_t step_us : {3'600'000'000LL, -7'200'000'000LL}) {
    const std::vector<LivePose> more = flight(11, kStart_us + step_us);
    poses.insert(poses.end(), more.begin(), more.end());
  }
  const CameraSimulationReport report = capture(poses);
  EXPECT_EQ(report.frames, 6);
  EXPECT_EQ(report.frames_missed, 0);
}

TEST_F(Film, CountsFramesThatLookBeyondTheWorld) {
  std::vector<LivePose> poses = flight(21);
  for (LivePose& pose : poses) pose.place = test::lonlat_at(placement(), 1, 50);
  EXPECT_EQ(capture(poses).frames_beyond_world, 3);
}

std::set<std::string> names_in(const std::filesystem::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) names.insert(entry.path().filename());
  return names;
}

TEST(FrameFolder, PicturesAppearWholeUnderTheirTime) {
  const test::TemporaryFolder folder;
  const std::filesystem::path path = folder.path() / "a" / "b";
  FrameFolder frames(path);
  const Bytes picture = {1, 2, 3};
  frames.put(picture, kStart_us);
  frames.put(picture, 5);
  EXPECT_EQ(names_in(path), (std::set<std::string>{"frame_1750000000000000.jpg", "frame_0000000000000005.jpg"}));
  EXPECT_EQ(read_file(path / "frame_0000000000000005.jpg"), picture);
}

TEST(FrameFolder, KeepsTheYoungestOfItsOwn) {
  const test::TemporaryFolder folder;
  write_file_atomic(folder.path() / "frame_0000000000000001.jpg", std::string_view("not mine"));
  FrameFolder frames(folder.path(), 2);
  const Bytes picture = {1};
  for (const std::int64_t time : {10, 11, 12, 11, 13}) frames.put(picture, time);  // the clock was set back once
  EXPECT_EQ(names_in(folder.path()), (std::set<std::string>{"frame_0000000000000001.jpg", "frame_0000000000000011.jpg",
                                                            "frame_0000000000000013.jpg"}));
}

TEST(FrameFolder, SaysWhenItCannot) {
  const test::TemporaryFolder folder;
  write_file_atomic(folder.path() / "file", std::string_view("x"));
  EXPECT_THROW(FrameFolder(folder.path() / "file"), Error);
  EXPECT_THROW(FrameFolder(folder.path() / "file" / "below"), Error);
  FrameFolder frames(folder.path() / "gone");
  std::filesystem::remove(folder.path() / "gone");
  const Bytes picture = {1};
  EXPECT_THROW(frames.put(picture, 1), Error);
}

TEST(FrameFolder, AFullDiskLeavesNothingHalf) {
  const test::TemporaryFolder folder;
  FrameFolder frames(folder.path());
  std::filesystem::create_symlink("/dev/full", folder.path() / ".frame_0000000000000007.jpg.tmp");
  const Bytes picture(100'000, 1);
  EXPECT_THROW(frames.put(picture, 7), Error);
  EXPECT_TRUE(names_in(folder.path()).empty());
}

TEST(FrameStream, IsReadByItsHeaders) {
  std::ostringstream out;
  FrameStream stream(out);
  const Bytes first = {0xFF, 0xD8, 13, 10, 45, 45}, second(300, 7);
  stream.put(first, 1'750'000'000'000'042);
  stream.put(second, 1'750'000'001'500'000);
  std::istringstream in(out.str());
  const auto part = [&] {
    std::vector<std::string> lines(5);
    for (std::string& line : lines) std::getline(in, line);
    Bytes body(std::stoul(lines[2].substr(16)));
    in.read(reinterpret_cast<char*>(body.data()), static_cast<std::streamsize>(body.size()));
    std::string end;
    std::getline(in, end);
    EXPECT_EQ(lines[0] + lines[1] + lines[4] + end, "--nadir-frame\rContent-Type: image/jpeg\r\r\r");
    return std::pair(lines[3], body);
  };
  EXPECT_EQ(part(), std::pair(std::string("X-Timestamp: 1750000000.000042\r"), first));
  EXPECT_EQ(part(), std::pair(std::string("X-Timestamp: 1750000001.500000\r"), second));
}

TEST(FrameStream, SaysWhenNobodyReadsAnyMore) {
  std::ofstream full("/dev/full");
  FrameStream stream(full);
  const Bytes picture(100'000, 1);
  EXPECT_THROW(stream.put(picture, 1), Error);
}

}  // namespace
}  // namespace nadir
