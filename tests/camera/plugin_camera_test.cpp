#include "camera/plugin_camera.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <thread>

#include "base/error.hpp"
#include "camera/camera_source.hpp"
#include "support/manual_clock.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;

class PluginCameraTest : public testing::Test {
 protected:
  PluginCamera camera(const std::string& source) { return {FAKE_PLUGIN, source, clock_}; }
  ManualClock clock_;
};

TEST_F(PluginCameraTest, DeliversPixelsWithTheirArrivalTime) {
  PluginCamera live = camera("rtsp:live");
  EXPECT_EQ(live.describe(), "rtsp:live (plug-in fake)");
  for (const char* name : {"000000", "000001"}) {
    clock_.advance(0.3);
    const CameraReading reading = live.next(0ms, {});
    ASSERT_EQ(reading.status, CameraStatus::frame);
    EXPECT_EQ(reading.frame.name, name);
    EXPECT_EQ(reading.frame.time_s, clock_.monotonic_s());
    EXPECT_EQ(reading.frame.bytes, Bytes(18, 7));
    ASSERT_TRUE(reading.frame.raw);
    EXPECT_EQ(reading.frame.raw->width, 3);
    EXPECT_EQ(reading.frame.raw->height, 2);
  }
}

TEST_F(PluginCameraTest, KnowsTheAgeOfStampedFrames) {
  PluginCamera stamped = camera("rtsp:stamped");
  EXPECT_EQ(stamped.next(0ms, {}).frame.age_s, 0);
  EXPECT_EQ(stamped.next(0ms, {}).frame.age_s, 0.04);
  EXPECT_EQ(camera("rtsp:live").next(0ms, {}).frame.age_s, std::nullopt);
}

TEST_F(PluginCameraTest, PlaysARecordingAtItsSpeed) {
  PluginCamera video = camera("video:recording");
  const double start_s = clock_.monotonic_s();
  EXPECT_EQ(video.next(0ms, {}).status, CameraStatus::frame);
  EXPECT_EQ(video.next(0ms, {}).status, CameraStatus::timeout) << "the frame is not due yet";
  clock_.advance(0.49);
  EXPECT_EQ(video.next(0ms, {}).status, CameraStatus::timeout);
  clock_.advance(0.02);
  const CameraReading second = video.next(0ms, {});
  ASSERT_EQ(second.status, CameraStatus::frame);
  EXPECT_NEAR(second.frame.time_s - start_s, 0.51, 1e-9);
  clock_.advance(0.5);
  EXPECT_EQ(video.next(0ms, {}).status, CameraStatus::frame);
  EXPECT_EQ(video.next(0ms, {}).status, CameraStatus::ended);
}

TEST_F(PluginCameraTest, StopEndsTheWaitForARecordedFrame) {
  PluginCamera video = camera("video:recording");
  ASSERT_EQ(video.next(0ms, {}).status, CameraStatus::frame);
  CameraStatus news = CameraStatus::frame;
  std::jthread reader([&](std::stop_token stop) { news = video.next(1h, stop).status; });
  reader.request_stop();
  reader.join();
  EXPECT_EQ(news, CameraStatus::timeout);
}

TEST_F(PluginCameraTest, ACameraThatDropsOutIsReopened) {
  PluginCamera drops = camera("rtsp:drops");
  EXPECT_EQ(drops.next(0ms, {}).status, CameraStatus::frame);
  const CameraReading gone = drops.next(0ms, {});
  EXPECT_EQ(gone.status, CameraStatus::failure);
  EXPECT_EQ(gone.detail, "the network is gone");
  const CameraReading again = drops.next(0ms, {});
  EXPECT_EQ(again.status, CameraStatus::frame);
  EXPECT_EQ(again.frame.name, "000001");
}

TEST_F(PluginCameraTest, ACameraThatCannotBeOpenedIsAFailure) {
  PluginCamera none = camera("rtsp:nowhere");
  for (int i = 0; i < 2; ++i) {
    const CameraReading reading = none.next(0ms, {});
    EXPECT_EQ(reading.status, CameraStatus::failure);
    EXPECT_THAT(reading.detail, HasSubstr("no such camera"));
  }
}

TEST_F(PluginCameraTest, InvalidFramesAreNotRead) {
  for (const char* source : {"rtsp:false-size", "rtsp:huge", "rtsp:false-age"}) {
    PluginCamera invalid = camera(source);
    EXPECT_EQ(invalid.next(0ms, {}).status, CameraStatus::failure) << source;
  }
  EXPECT_EQ(camera("rtsp:none").next(0ms, {}).status, CameraStatus::timeout);
}

TEST_F(PluginCameraTest, APluginOfAnotherVersionIsRejected) {
  const test::TemporaryFolder folder;
  EXPECT_THROW((PluginCamera{folder / "missing.so", "x", clock_}), Error);
  EXPECT_THROW((PluginCamera{folder.write("text.so", "not a library"), "x", clock_}), Error);
  EXPECT_THROW((PluginCamera{"libc.so.6", "x", clock_}), Error) << "a library without the symbol";
  try {
    const PluginCamera old(OLD_PLUGIN, "x", clock_);
    ADD_FAILURE() << "another version was loaded";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("version 999"));
  }
}

TEST_F(PluginCameraTest, OpenCameraOpensTheNamedSource) {
  const test::TemporaryFolder folder;
  std::filesystem::create_directory(folder / "a:b");
  EXPECT_EQ(open_camera("folder:/x/y", clock_)->describe(), "folder /x/y");
  EXPECT_EQ(open_camera("/x/y", clock_)->describe(), "folder /x/y");
  EXPECT_EQ(open_camera((folder / "a:b").string(), clock_)->describe(), "folder " + (folder / "a:b").string());
  std::filesystem::copy(FAKE_PLUGIN, folder / "nadir_camera_video.so");
  EXPECT_THAT(open_camera("rtsp:live", clock_, {"/nowhere", folder.path()})->describe(), HasSubstr("fake"));
  EXPECT_THROW(open_camera("", clock_), UsageError);
  EXPECT_THROW(open_camera("gopher://camera", clock_), UsageError);
  try {
    open_camera("video:flight.mp4", clock_, {"/nowhere"});
    ADD_FAILURE() << "found a plug-in that does not exist";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("/nowhere"));
    EXPECT_THAT(error.what(), HasSubstr("libopencv-videoio-dev"));
  }
  try {
    open_camera("gstreamer:videotestsrc", clock_, {"/nowhere"});
    ADD_FAILURE() << "found a plug-in that does not exist";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("nadir_camera_gstreamer.so"));
    EXPECT_THAT(error.what(), HasSubstr("libgstreamer1.0-dev"));
  }
}

// ---- user and password of a network camera

constexpr const char* kSecretSource = "rtsp://pilot:s3cret/@10.0.0.5:554/live?x=1";

TEST(CameraSecrets, NoTextShowsThem) {
  EXPECT_EQ(redacted(kSecretSource), "rtsp://10.0.0.5:554/live?x=1");
  EXPECT_EQ(redacted("rtsp://10.0.0.5/live"), "rtsp://10.0.0.5/live");
  EXPECT_EQ(redacted("folder:/data/a@b"), "folder:/data/a@b");
  const ManualClock clock;
  PluginCamera camera(FAKE_PLUGIN, kSecretSource, clock);
  EXPECT_EQ(camera.describe().find("s3cret"), std::string::npos) << camera.describe();
  const CameraReading reading = camera.next(std::chrono::milliseconds(0), {});
  ASSERT_EQ(reading.status, CameraStatus::failure);
  EXPECT_EQ(reading.detail.find("s3cret"), std::string::npos) << reading.detail;
  EXPECT_NE(reading.detail.find("10.0.0.5"), std::string::npos) << "which camera: " << reading.detail;
  try {
    open_camera("pigeon://pilot:s3cret@loft", clock);
    ADD_FAILURE() << "an unknown kind";
  } catch (const UsageError& error) {
    EXPECT_EQ(std::string(error.what()).find("s3cret"), std::string::npos) << error.what();
  }
}

TEST(CameraSecrets, AreReadFromAnOwnerOnlyFile) {
  const test::TemporaryFolder folder;
  const auto file = folder.write("camera", "pilot:p@ss:w/rd\n");
  std::filesystem::permissions(file, std::filesystem::perms(0600));
  EXPECT_EQ(with_credentials("rtsp://10.0.0.5/live", file), "rtsp://pilot:p%40ss%3Aw%2Frd@10.0.0.5/live");
  EXPECT_THROW(with_credentials("folder:/data", file), UsageError);
  EXPECT_THROW(with_credentials("rtsp://a:b@10.0.0.5/live", file), UsageError) << "ambiguous credentials";
  EXPECT_THROW(with_credentials("rtsp://10.0.0.5/live", folder / "none"), Error);
  std::filesystem::permissions(file, std::filesystem::perms(0640));
  EXPECT_THROW(with_credentials("rtsp://10.0.0.5/live", file), UsageError);
  for (const char* text : {"", "pilot", ":secret", "pilot:secret\nanother line"}) {
    const auto other = folder.write("other", text);
    std::filesystem::permissions(other, std::filesystem::perms(0600));
    try {
      with_credentials("rtsp://10.0.0.5/live", other);
      ADD_FAILURE() << text;
    } catch (const UsageError& error) {
      EXPECT_EQ(std::string(error.what()).find("secret\n"), std::string::npos);
    }
  }
}

}  // namespace
}  // namespace nadir
