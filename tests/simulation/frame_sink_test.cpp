#include "simulation/frame_sink.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <atomic>
#include <csignal>
#include <fstream>
#include <set>
#include <sstream>
#include <stdexcept>
#include <thread>
#include <vector>

#include "base/error.hpp"
#include "base/files.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

using std::chrono::hours;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr std::int64_t kFirst_us = 1'750'000'000'000'000;

class ListingSink final : public FrameSink {
 public:
  void put(ByteView jpeg, std::int64_t unix_us) override {
    if (jpeg.empty()) throw std::runtime_error("no room");
    times_us.push_back(unix_us);
    at.push_back(steady_clock::now());
  }
  std::vector<std::int64_t> times_us;
  std::vector<steady_clock::time_point> at;
};

TEST(DelayedSink, DeliversInOrderAndNotBeforeTheDueTime) {
  ListingSink kept;
  const auto now = steady_clock::now();
  {
    DelayedSink sink(kept);
    for (int i = 0; i < 8; ++i) sink.put({1}, i, now + milliseconds(20 + i));
    sink.finish();
    EXPECT_EQ(sink.delivered(), 8);
  }
  ASSERT_EQ(kept.times_us, (std::vector<std::int64_t>{0, 1, 2, 3, 4, 5, 6, 7}));
  for (int i = 0; i < 8; ++i) EXPECT_GE(kept.at[static_cast<std::size_t>(i)], now + milliseconds(20 + i));
}

// The producer does not wait until a frame is due.
TEST(DelayedSink, AcceptsFramesWhileOneWaits) {
  ListingSink kept;
  DelayedSink sink(kept);
  for (int i = 0; i < 100; ++i) sink.put({1}, i, steady_clock::now() + hours(1));
  EXPECT_EQ(sink.delivered(), 0);
}  // and ends at once, dropping them

TEST(DelayedSink, RethrowsTheErrorOfTheSink) {
  ListingSink kept;
  DelayedSink sink(kept);
  sink.put({1}, 1, steady_clock::now());
  sink.put({}, 2, steady_clock::now());
  EXPECT_THROW(sink.finish(), std::runtime_error);
  EXPECT_THROW(sink.put({1}, 3, steady_clock::now()), std::runtime_error);
  EXPECT_EQ(sink.delivered(), 1);
  EXPECT_EQ(kept.times_us, std::vector<std::int64_t>{1});
}

TEST(DelayedSink, AnEmptyQueueFinishesAtOnce) {
  ListingSink kept;
  DelayedSink sink(kept);
  sink.finish();
  EXPECT_EQ(sink.delivered(), 0);
}

std::set<std::string> names_in(const std::filesystem::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) names.insert(entry.path().filename());
  return names;
}

TEST(FrameFolder, FramesAppearAtomicallyNamedByTheirTime) {
  const test::TemporaryFolder folder;
  const std::filesystem::path path = folder.path() / "a" / "b";
  FrameFolder frames(path);
  const Bytes jpeg = {1, 2, 3};
  frames.put(jpeg, kFirst_us);
  frames.put(jpeg, 5);
  EXPECT_EQ(names_in(path), (std::set<std::string>{"frame_1750000000000000.jpg", "frame_0000000000000005.jpg"}));
  EXPECT_EQ(read_file(path / "frame_0000000000000005.jpg"), jpeg);
}

TEST(FrameFolder, KeepsTheNewestOfItsOwn) {
  const test::TemporaryFolder folder;
  write_file_atomic(folder.path() / "frame_0000000000000001.jpg", std::string_view("not mine"));
  FrameFolder frames(folder.path(), 2);
  const Bytes jpeg = {1};
  for (const std::int64_t time : {10, 11, 12, 11, 13}) frames.put(jpeg, time);  // the clock was set back once
  EXPECT_EQ(names_in(folder.path()), (std::set<std::string>{"frame_0000000000000001.jpg", "frame_0000000000000011.jpg",
                                                            "frame_0000000000000013.jpg"}));
}

TEST(FrameFolder, ReportsAnUnusableFolder) {
  const test::TemporaryFolder folder;
  write_file_atomic(folder.path() / "file", std::string_view("x"));
  EXPECT_THROW(FrameFolder(folder.path() / "file"), Error);
  EXPECT_THROW(FrameFolder(folder.path() / "file" / "below"), Error);
  FrameFolder frames(folder.path() / "gone");
  std::filesystem::remove(folder.path() / "gone");
  const Bytes jpeg = {1};
  EXPECT_THROW(frames.put(jpeg, 1), Error);
}

// The system takes no more than 50 kB, as a disk that is full.
TEST(FrameFolder, AFullDiskLeavesNoPartialFrame) {
  const test::TemporaryFolder folder;
  FrameFolder frames(folder.path());
  const Bytes jpeg(100'000, 1);
  rlimit before{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto on_signal = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit small{50'000, before.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
  EXPECT_THROW(frames.put(jpeg, 7), Error);
  ::setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, on_signal);
  EXPECT_TRUE(names_in(folder.path()).empty());
}

// The hidden name was the frame's own with ".tmp": whoever may write into the folder could have a link there.
TEST(FrameFolder, FollowsNoLinkThatWasPlanted) {
  const test::TemporaryFolder folder, elsewhere;
  write_file_atomic(elsewhere / "precious", std::string_view("unharmed"));
  for (const char* name : {".frame_0000000000000007.jpg.tmp", "frame_0000000000000007.jpg"}) {
    std::filesystem::create_symlink(elsewhere / "precious", folder / name);
  }
  FrameFolder frames(folder.path());
  const Bytes jpeg = {1, 2, 3};
  frames.put(jpeg, 7);
  EXPECT_EQ(read_text_file(elsewhere / "precious"), "unharmed");
  EXPECT_FALSE(std::filesystem::is_symlink(folder / "frame_0000000000000007.jpg"));
  EXPECT_EQ(read_file(folder / "frame_0000000000000007.jpg"), jpeg);
}

// Whoever opens a frame's file as soon as its name is there reads all of it, and may read it as another user.
TEST(FrameFolder, AFrameIsWholeAndReadableOnceItHasItsName) {
  const test::TemporaryFolder folder;
  FrameFolder frames(folder.path());
  const Bytes jpeg(1'000'000, 7);
  std::atomic<bool> done = false;
  int seen = 0, short_ones = 0;
  std::thread reader([&] {
    while (!done || seen == 0) {
      for (const std::string& name : names_in(folder.path())) {
        if (name.starts_with('.')) continue;
        std::error_code gone;
        const auto size = std::filesystem::file_size(folder / name, gone);
        if (gone) continue;
        ++seen;
        short_ones += size == jpeg.size() ? 0 : 1;
      }
    }
  });
  for (int i = 0; i < 50; ++i) frames.put(jpeg, i);
  done = true;
  reader.join();
  EXPECT_EQ(short_ones, 0);
  const auto mode = std::filesystem::status(folder / "frame_0000000000000049.jpg").permissions();
  EXPECT_EQ(static_cast<unsigned>(mode), 0644U);
}

TEST(FrameStream, IsParsedByItsHeaders) {
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

TEST(FrameStream, ReportsAClosedPipe) {
  std::ofstream full("/dev/full");
  FrameStream stream(full);
  const Bytes jpeg(100'000, 1);
  EXPECT_THROW(stream.put(jpeg, 1), Error);
}

}  // namespace
}  // namespace nadir
