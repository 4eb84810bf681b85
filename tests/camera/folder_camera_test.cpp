// Real files in a real folder. inotify events are queued when the call that caused them returns, so no test waits for
// time to pass.
#include "camera/folder_camera.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <fstream>
#include <opencv2/core.hpp>
#include <thread>

#include "base/files.hpp"
#include "imagery/codecs.hpp"
#include "support/manual_clock.hpp"
#include "support/temporary_folder.hpp"
#include "support/tiff_writer.hpp"

namespace nadir {
namespace {

using namespace std::chrono_literals;

Bytes picture(int shade, ImageFormat format = ImageFormat::jpeg) {
  cv::Mat image(48, 64, CV_8UC3, cv::Scalar(shade, 255 - shade, 128));
  image(cv::Rect(10, 10, 20, 20)).setTo(cv::Scalar(0, 0, 255));
  return encode_image(image, format);
}

class FolderCameraTest : public testing::Test {
 protected:
  void write(const std::string& name, const Bytes& bytes) { write_file_atomic(folder_ / name, ByteView(bytes)); }

  // Like a slow camera: the name exists before the image is complete.
  int begin(const std::string& name, const Bytes& bytes, std::size_t count) {
    const int fd = ::open((folder_ / name).c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
    append(fd, bytes, 0, count);
    return fd;
  }
  static void append(int fd, const Bytes& bytes, std::size_t from, std::size_t to) {
    ASSERT_EQ(::write(fd, bytes.data() + from, to - from), static_cast<ssize_t>(to - from));
  }

  CameraReading next(CameraSource& camera) { return camera.next(0ms, {}); }
  // The name of the next image, or the reading's kind instead.
  std::string name(CameraSource& camera) {
    const CameraReading reading = next(camera);
    if (reading.status == CameraStatus::frame) return reading.frame.name;
    return reading.status == CameraStatus::timeout ? "nothing" : "failure";
  }

  test::TemporaryFolder folder_;
  ManualClock clock_;
};

TEST_F(FolderCameraTest, DeliversCompleteImagesWithTheirTimes) {
  FolderCamera camera(folder_.path(), clock_);
  EXPECT_EQ(name(camera), "nothing");
  int shade = 0;
  for (const ImageFormat format : {ImageFormat::jpeg, ImageFormat::png, ImageFormat::webp}) {
    clock_.advance(0.5);
    const Bytes bytes = picture(shade += 40, format);
    const std::string file = fmt::format("frame_{}.{}", shade, name_of(format));
    write(file, bytes);
    const CameraReading reading = next(camera);
    ASSERT_EQ(reading.status, CameraStatus::frame) << reading.detail;
    EXPECT_EQ(reading.frame.name, file);
    EXPECT_EQ(reading.frame.bytes, bytes);
    EXPECT_EQ(reading.frame.time_s, clock_.monotonic_s());
    EXPECT_FALSE(reading.frame.raw);
  }
  EXPECT_EQ(name(camera), "nothing");
}

TEST_F(FolderCameraTest, NeverDeliversAPartialImage) {
  FolderCamera camera(folder_.path(), clock_);
  next(camera);
  const Bytes bytes = picture(90);
  const int fd = begin("a.jpg", bytes, 100);
  EXPECT_EQ(name(camera), "nothing");
  append(fd, bytes, 100, bytes.size() - 1);
  EXPECT_EQ(name(camera), "nothing");
  append(fd, bytes, bytes.size() - 1, bytes.size());
  EXPECT_EQ(name(camera), "nothing") << "complete, but its writer may continue";
  ::close(fd);
  EXPECT_EQ(name(camera), "a.jpg");
}

TEST_F(FolderCameraTest, ATruncatedImageIsABadFrameUntilItIsComplete) {
  FolderCamera camera(folder_.path(), clock_);
  next(camera);
  for (const ImageFormat format : {ImageFormat::jpeg, ImageFormat::png, ImageFormat::webp}) {
    const Bytes bytes = picture(90, format);
    for (const std::size_t size :
         {std::size_t{0}, std::size_t{1}, std::size_t{20}, bytes.size() / 2, bytes.size() - 1}) {
      const std::string file = fmt::format("{}.{}", size, name_of(format));
      ::close(begin(file, bytes, size));
      const CameraReading reading = next(camera);
      EXPECT_EQ(reading.status, CameraStatus::bad_frame) << file;
      EXPECT_NE(reading.detail.find(file), std::string::npos) << reading.detail;
      EXPECT_EQ(name(camera), "nothing") << "reported once";
      const int fd = ::open((folder_ / file).c_str(), O_WRONLY | O_APPEND);
      append(fd, bytes, size, bytes.size());
      ::close(fd);
      EXPECT_EQ(name(camera), file);
    }
  }
}

TEST_F(FolderCameraTest, DeliversAnImageThatIsRenamedIntoPlaceOnce) {
  FolderCamera camera(folder_.path(), clock_);
  next(camera);
  const int fd = begin(".a.jpg.part", picture(90), picture(90).size());
  ::close(fd);
  EXPECT_EQ(name(camera), "nothing");
  std::filesystem::rename(folder_ / ".a.jpg.part", folder_ / "a.jpg");
  EXPECT_EQ(name(camera), "a.jpg");
  EXPECT_EQ(name(camera), "nothing");
  ::close(::open((folder_ / "a.jpg").c_str(), O_WRONLY | O_APPEND));  // opened and closed, nothing changed
  EXPECT_EQ(name(camera), "nothing");
}

TEST_F(FolderCameraTest, ANewImageUnderTheSameNameIsDelivered) {
  FolderCamera camera(folder_.path(), clock_);
  next(camera);
  for (int i = 0; i < 5; ++i) {
    const Bytes bytes = picture(20 + 40 * i);
    write("latest.jpg", bytes);
    const CameraReading reading = next(camera);
    ASSERT_EQ(reading.status, CameraStatus::frame) << i;
    EXPECT_EQ(reading.frame.bytes, bytes);
  }
}

TEST_F(FolderCameraTest, ABurstIsDeliveredInTheOrderOfNames) {
  FolderCamera camera(folder_.path(), clock_);
  next(camera);
  for (int i = 29; i >= 0; --i) write(fmt::format("frame_{:04}.jpg", i), picture(i));
  for (int i = 0; i < 30; ++i) EXPECT_EQ(name(camera), fmt::format("frame_{:04}.jpg", i));
  EXPECT_EQ(name(camera), "nothing");
  write("frame_0000.jpg", picture(200));  // the camera's counter restarted
  EXPECT_EQ(name(camera), "frame_0000.jpg");
}

TEST_F(FolderCameraTest, WhenTheKernelLosesEventsTheFolderIsScanned) {
  int limit = 0;
  std::ifstream("/proc/sys/fs/inotify/max_queued_events") >> limit;
  if (limit <= 0 || limit > 100'000) GTEST_SKIP() << "the kernel's queue is too long to be filled here";
  FolderCamera camera(folder_.path(), clock_);
  next(camera);
  write("a.jpg", picture(10));
  EXPECT_EQ(name(camera), "a.jpg");
  for (int i = 0; i < limit + 2; ++i) {
    ::close(::open((folder_ / (i % 2 == 0 ? "x.txt" : "y.txt")).c_str(), O_WRONLY | O_CREAT, 0644));
  }
  write("c.jpg", picture(20));
  write("b.jpg", picture(30));
  EXPECT_EQ(name(camera), "b.jpg");
  EXPECT_EQ(name(camera), "c.jpg");
  EXPECT_EQ(name(camera), "nothing") << "a.jpg was seen";
}

TEST_F(FolderCameraTest, ExistingImagesAreStaleUnlessRequested) {
  for (const char* file : {"b.jpg", "a.jpg", "c.jpg"}) write(file, picture(10));
  write("notes.txt", {'x'});
  const Bytes bytes = picture(60);
  const int fd = begin("d.jpg", bytes, 50);  // being written while we start

  FolderCamera skips(folder_.path(), clock_), newest(folder_.path(), clock_, Backlog::newest),
      all(folder_.path(), clock_, Backlog::all);
  EXPECT_EQ(name(skips), "nothing");
  EXPECT_EQ(name(newest), "failure") << "d.jpg, not complete yet";
  for (const char* file : {"a.jpg", "b.jpg", "c.jpg"}) EXPECT_EQ(name(all), file);
  EXPECT_EQ(name(all), "failure");
  append(fd, bytes, 50, bytes.size());
  ::close(fd);
  EXPECT_EQ(name(skips), "d.jpg");
  EXPECT_EQ(name(newest), "d.jpg");
  EXPECT_EQ(name(all), "d.jpg");
  for (FolderCamera* camera : {&skips, &newest, &all}) EXPECT_EQ(name(*camera), "nothing");
}

TEST_F(FolderCameraTest, OtherFilesAreIgnored) {
  FolderCamera camera(folder_.path(), clock_);
  next(camera);
  write("log.txt", picture(10));
  write("noextension", picture(10));
  std::filesystem::create_directory(folder_ / "folder.jpg");
  ASSERT_EQ(::mkfifo((folder_ / "pipe").c_str(), 0600), 0);
  std::filesystem::rename(folder_ / "pipe", folder_ / "pipe.jpg");
  std::filesystem::create_directory(folder_ / "elsewhere");
  std::filesystem::rename(folder_ / "folder.jpg", folder_ / "moved.jpg");
  EXPECT_EQ(name(camera), "nothing");
  write("text.jpg", {'n', 'o', ' ', 'p', 'i', 'c', 't', 'u', 'r', 'e', ' ', 'a', 't', ' ', 'a', 'l', 'l'});
  EXPECT_EQ(name(camera), "failure");
  write("UPPER.JPG", picture(10));
  EXPECT_EQ(name(camera), "UPPER.JPG");
}

TEST_F(FolderCameraTest, ARemovedImageIsIgnored) {
  FolderCamera camera(folder_.path(), clock_);
  next(camera);
  write("a.jpg", picture(10));
  write("b.jpg", picture(20));
  std::filesystem::remove(folder_ / "a.jpg");
  EXPECT_EQ(name(camera), "b.jpg");
}

TEST_F(FolderCameraTest, AMissingFolderIsAFailureUntilItIsBack) {
  const auto path = folder_ / "frames";
  FolderCamera camera(path, clock_);
  EXPECT_EQ(name(camera), "failure");
  std::filesystem::create_directory(path);
  EXPECT_EQ(name(camera), "nothing");
  write("frames/a.jpg", picture(10));
  EXPECT_EQ(name(camera), "a.jpg");

  std::filesystem::remove_all(path);
  EXPECT_EQ(name(camera), "failure");
  EXPECT_EQ(name(camera), "failure");
  std::filesystem::create_directory(path);
  EXPECT_EQ(name(camera), "nothing");
  write("frames/b.jpg", picture(10));
  EXPECT_EQ(name(camera), "b.jpg");

  std::filesystem::rename(path, folder_ / "moved");
  EXPECT_EQ(name(camera), "failure");
  EXPECT_EQ(name(camera), "failure");
}

TEST_F(FolderCameraTest, StopAndAnImageEndTheWait) {
  FolderCamera camera(folder_.path(), clock_);
  next(camera);
  CameraStatus news = CameraStatus::frame;
  std::jthread reader([&](const std::stop_token& stop) { news = camera.next(1h, stop).status; });
  reader.request_stop();
  reader.join();
  EXPECT_EQ(news, CameraStatus::timeout);
  EXPECT_EQ(name(camera), "nothing");

  std::string got;
  std::jthread waiting([&](const std::stop_token& stop) {
    while (got.empty() && !stop.stop_requested()) got = camera.next(1h, stop).frame.name;
  });
  write("a.jpg", picture(10));
  waiting.join();
  EXPECT_EQ(got, "a.jpg");
}

// A thread of real-time priority keeps the camera's one from its processor.
TEST_F(FolderCameraTest, AnImageThatIsNoticedLateHasTheTimeAtWhichItCame) {
  constexpr double kHeld_s = 0.8;
  cpu_set_t allowed, one;
  ASSERT_EQ(::sched_getaffinity(0, sizeof allowed, &allowed), 0);
  if (CPU_COUNT(&allowed) < 2) GTEST_SKIP() << "there is one processor alone";
  std::size_t cpu = 0;
  while (!CPU_ISSET(cpu, &allowed)) ++cpu;
  CPU_ZERO(&one);
  CPU_SET(cpu, &one);
  cpu_set_t others = allowed;
  CPU_CLR(cpu, &others);
  ASSERT_EQ(::sched_setaffinity(0, sizeof others, &others), 0);

  const SystemFlightClock clock;
  FolderCamera camera(folder_.path(), clock);
  EXPECT_EQ(name(camera), "nothing");
  CameraReading reading;
  std::jthread waiting([&] {
    ::sched_setaffinity(0, sizeof one, &one);
    reading = camera.next(60s, {});
  });
  std::atomic<int> holds = 0;  // 1: it does; −1: it may not
  const double end_s = clock.monotonic_s() + kHeld_s;
  std::jthread holding([&] {
    ::sched_setaffinity(0, sizeof one, &one);
    const sched_param first{.sched_priority = 1};
    holds = ::sched_setscheduler(0, SCHED_FIFO, &first) == 0 ? 1 : -1;
    while (holds > 0 && clock.monotonic_s() < end_s) {
    }
  });
  while (holds == 0) std::this_thread::sleep_for(1ms);
  write("a.jpg", picture(1));
  const double written_s = clock.monotonic_s();
  holding.join();
  waiting.join();
  ASSERT_EQ(::sched_setaffinity(0, sizeof allowed, &allowed), 0);
  if (holds < 0) GTEST_SKIP() << "no right to a real-time priority";
  ASSERT_EQ(reading.status, CameraStatus::frame);
  EXPECT_LT(reading.frame.time_s, written_s + kHeld_s / 2);
  EXPECT_GT(reading.frame.time_s, written_s - kHeld_s / 2);
}

TEST(CompleteImage, DetectsEveryTruncation) {
  for (const ImageFormat format : {ImageFormat::jpeg, ImageFormat::png, ImageFormat::webp}) {
    const Bytes bytes = picture(70, format);
    ASSERT_TRUE(is_complete_image(bytes));
    for (std::size_t size = 0; size < bytes.size(); ++size) {
      ASSERT_FALSE(is_complete_image(ByteView(bytes).first(size))) << name_of(format) << " " << size;
    }
  }
}

TEST(CompleteImage, TiffIsCompleteWithItsLastStrip) {
  const test::TemporaryFolder folder;
  test::write_tiff(folder / "a.tif", cv::Mat(60, 80, CV_8UC1, cv::Scalar(70)));
  const Bytes bytes = read_file(folder / "a.tif");
  EXPECT_TRUE(has_image_name("a.TIF"));
  ASSERT_TRUE(is_complete_image(bytes));
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    ASSERT_FALSE(is_complete_image(ByteView(bytes).first(size))) << size;
  }
}

TEST(CompleteImage, PaddingAfterTheEndIsAllowedOtherBytesAreNot) {
  Bytes padded = picture(70);
  padded.resize(padded.size() + 4000, 0);
  EXPECT_TRUE(is_complete_image(padded));
  padded.back() = 7;
  EXPECT_FALSE(is_complete_image(padded));
  EXPECT_FALSE(is_complete_image(Bytes(1000, 0)));
  EXPECT_FALSE(is_complete_image({}));
}

}  // namespace
}  // namespace nadir
