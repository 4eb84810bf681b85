// The real plug-in with a real recording and a real network camera, where OpenCV's videoio is installed.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>

#include "base/files.hpp"
#include "camera/camera_source.hpp"
#include "flight/preflight.hpp"
#include "flight/video_stream_finder.hpp"
#include "service/clock.hpp"
#include "support/manual_clock.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using namespace std::chrono_literals;

constexpr int kWidth = 64, kHeight = 48, kPictures = 4;

int grey(int picture) { return 40 + 50 * picture; }

// At five frames a second.
std::string recording(const test::TemporaryFolder& folder) {
  std::string file = (folder / "flight.avi").string();
  cv::VideoWriter writer(file, cv::CAP_OPENCV_MJPEG, cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 5, {kWidth, kHeight});
  EXPECT_TRUE(writer.isOpened());
  for (int i = 0; i < kPictures; ++i) writer.write(cv::Mat(kHeight, kWidth, CV_8UC3, cv::Scalar::all(grey(i))));
  return file;
}

// The number of a frame in that recording, if any.
int picture_of(const CameraFrame& frame) {
  const auto middle = static_cast<std::size_t>(kWidth * kHeight / 2 * 3);
  EXPECT_TRUE(frame.raw && frame.raw->width == kWidth && frame.raw->height == kHeight);
  if (!frame.raw || frame.bytes.size() != 2 * middle) return -1;
  for (int i = 0; i < kPictures; ++i) {
    if (std::abs(frame.bytes[middle] - grey(i)) < 8) return i;
  }
  return -1;
}

TEST(VideoPlugin, PlaysARecordingToItsEnd) {
  const test::TemporaryFolder folder;
  const std::string file = recording(folder);
  ManualClock clock;
  const auto camera = open_camera("video:" + file, clock, {PLUGIN_FOLDER});
  const double start_s = clock.monotonic_s();
  for (int i = 0; i < kPictures; ++i) {
    CameraReading reading = camera->next(0ms, {});
    ASSERT_NE(reading.status, CameraStatus::ended) << i;
    if (reading.status == CameraStatus::timeout) {
      clock.advance(0.2001);
      reading = camera->next(0ms, {});
    }
    ASSERT_EQ(reading.status, CameraStatus::frame) << reading.detail;
    EXPECT_EQ(picture_of(reading.frame), i);
    EXPECT_NEAR(reading.frame.time_s - start_s, 0.2 * i, 0.01);
  }
  EXPECT_EQ(camera->next(0ms, {}).status, CameraStatus::ended);
}

TEST(VideoPlugin, AnInvalidVideoIsAFailure) {
  const test::TemporaryFolder folder;
  ManualClock clock;
  for (const auto& file : {folder.write("text.avi", "no video"), folder / "missing.avi"}) {
    EXPECT_EQ(open_camera("video:" + file.string(), clock, {PLUGIN_FOLDER})->next(0ms, {}).status,
              CameraStatus::failure);
  }
}

// A script in its own process, until the end of this.
class Script {
 public:
  explicit Script(std::vector<std::string> words) {
    std::array<int, 2> pipe_ends{};
    EXPECT_EQ(::pipe(pipe_ends.data()), 0);
    process_ = ::fork();
    if (process_ == 0) {
      ::dup2(pipe_ends[1], STDOUT_FILENO);
      std::vector<char*> argv;
      for (std::string& word : words) argv.push_back(word.data());
      argv.push_back(nullptr);
      ::execvp(argv[0], argv.data());
      ::_exit(127);
    }
    ::close(pipe_ends[1]);
    said_.reset(::fdopen(pipe_ends[0], "r"));
  }
  ~Script() {
    ::kill(process_, SIGKILL);
    ::waitpid(process_, nullptr, 0);
  }
  Script(const Script&) = delete;
  Script& operator=(const Script&) = delete;

  int number() const {
    int number = 0;
    EXPECT_EQ(std::fscanf(said_.get(), "%d", &number), 1);
    return number;
  }

 private:
  pid_t process_ = -1;
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> said_{nullptr, std::fclose};
};

// network_camera.py, five frames a second.
class NetworkCamera {
 public:
  explicit NetworkCamera(const std::string& recording, int port = 0)
      : script_({"python3", NETWORK_CAMERA, std::to_string(port), "5", recording}), port_(script_.number()) {}

  int port() const { return port_; }

 private:
  Script script_;
  int port_;
};

// The next reading other than a timeout, however long it takes: the test's time limit ends a hang.
CameraReading news_of(CameraSource& camera) {
  CameraReading reading;
  while (reading.status == CameraStatus::timeout) reading = camera.next(100ms, {});
  return reading;
}

// On a busy computer a working camera may appear dead.
void expect_pictures(CameraSource& camera, double& last_s) {
  for (int seen = 0; seen < 4;) {
    const CameraReading reading = news_of(camera);
    if (reading.status != CameraStatus::frame) continue;
    EXPECT_GE(picture_of(reading.frame), 0);
    EXPECT_GT(reading.frame.time_s, last_s);
    last_s = reading.frame.time_s;
    ++seen;
  }
}

TEST(VideoPlugin, ReconnectsToANetworkCamera) {
  const test::TemporaryFolder folder;
  const SystemFlightClock clock;
  const std::string file = recording(folder);
  auto server = std::make_unique<NetworkCamera>(file);
  const int port = server->port();
  const auto camera = open_camera("rtsp://127.0.0.1:" + std::to_string(port) + "/cam", clock, {PLUGIN_FOLDER});
  double last_s = 0;
  expect_pictures(*camera, last_s);
  server.reset();
  while (news_of(*camera).status == CameraStatus::frame) {
  }  // frames in transit; then a failure
  server = std::make_unique<NetworkCamera>(file, port);
  expect_pictures(*camera, last_s);
}

// Camera Protocol v2, with pymavlink as the camera: it names the RTSP server, of which the plug-in then gets pictures.
class MavlinkCameraTest : public ::testing::Test {
 protected:
  // What is found of these streams, over a link that is signed with `ours`, by a camera that signs with `theirs`.
  PartCheck find(const std::string& streams, const std::string& theirs = "none", const std::string& ours = "none",
                 double limit_s = 20) {
    auto transport = make_transport(parse_endpoint("udpin:127.0.0.1:0"));
    transport->advance(0, [](const Transport::Arrival&) {});
    const Script camera({NADIR_PYTHON, MAVLINK_CAMERA, std::to_string(transport->local_port()), theirs, streams});
    std::optional<Signing> signing;
    SigningTime time(folder_ / "signing-time", clock_.unix_us(), std::llround(clock_.monotonic_s() * 1e6));
    if (ours != "none") signing.emplace(SigningKey::read(private_file(ours)), time, 1);
    return find_stream(std::move(transport), Airframe{}, std::move(signing), finder_, clock_, limit_s);
  }
  std::filesystem::path private_file(const std::string& text) {
    write_file_atomic(folder_ / "link.key", text, 0600);
    return folder_ / "link.key";
  }
  std::string stream(const std::string& uri, int width = kWidth, int type = 0) {
    return fmt::format(R"([{{"type": {}, "width": {}, "height": {}, "uri": "{}"}}])", type, width, width * 3 / 4, uri);
  }

  const test::TemporaryFolder folder_;
  const SystemFlightClock clock_;
  VideoStreamFinder finder_{1, {100}, kWidth, kHeight};
};

TEST_F(MavlinkCameraTest, ItsStreamIsFoundAndShowsPictures) {
  const NetworkCamera server(recording(folder_));
  const std::string uri = fmt::format("rtsp://127.0.0.1:{}/cam", server.port());
  const PartCheck part = find(stream(uri));
  ASSERT_FALSE(part.findings.has_errors()) << part.found;
  EXPECT_EQ(part.found, uri);
  StreamCamera camera(finder_, [&](const std::string& at) { return open_camera(at, clock_, {PLUGIN_FOLDER}); });
  double last_s = 0;
  expect_pictures(camera, last_s);
  EXPECT_EQ(camera.describe(), open_camera(uri, clock_, {PLUGIN_FOLDER})->describe());
}

TEST_F(MavlinkCameraTest, OnASignedLinkTheCameraMustSign) {
  const std::string key(64, 'a'), other(64, 'b');
  EXPECT_TRUE(find(stream("rtsp://10.0.0.6/1"), other, key, 2).findings.contains("camera.no_stream"));
  EXPECT_TRUE(find(stream("rtsp://10.0.0.6/1"), "none", key, 2).findings.contains("camera.no_stream"));
  EXPECT_FALSE(find(stream("rtsp://10.0.0.6/1"), key, key).findings.has_errors());
}

TEST_F(MavlinkCameraTest, WhatItOffersInsteadIsNamed) {
  const PartCheck part = find(stream("5600", 1920, 1), "none", "none", 8);
  ASSERT_TRUE(part.findings.contains("camera.no_stream"));
  EXPECT_THAT(part.found, testing::HasSubstr("Example Eye 1: 1: RTP, 1920 x 1440"));
}

}  // namespace
}  // namespace nadir
