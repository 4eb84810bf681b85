// The real plug-in with a real recording and a real network camera, where OpenCV's videoio is installed.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>

#include "camera/camera_source.hpp"
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

// network_camera.py in its own process, five frames a second.
class NetworkCamera {
 public:
  explicit NetworkCamera(const std::string& recording, int port = 0) {
    std::vector<std::string> words = {"python3", NETWORK_CAMERA, std::to_string(port), "5", recording};
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
    const std::unique_ptr<std::FILE, int (*)(std::FILE*)> said(::fdopen(pipe_ends[0], "r"), std::fclose);
    EXPECT_EQ(std::fscanf(said.get(), "%d", &port_), 1);
  }
  ~NetworkCamera() {
    ::kill(process_, SIGKILL);
    ::waitpid(process_, nullptr, 0);
  }
  NetworkCamera(const NetworkCamera&) = delete;
  NetworkCamera& operator=(const NetworkCamera&) = delete;

  int port() const { return port_; }

 private:
  pid_t process_ = -1;
  int port_ = 0;
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

}  // namespace
}  // namespace nadir
