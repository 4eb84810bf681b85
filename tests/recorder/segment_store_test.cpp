// Segments by size and time, the budget, and a disk without room. Time is handed in; no thread runs.
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>

#include "base/error.hpp"
#include "base/files.hpp"
#include "recorder/sample_records.hpp"
#include "recorder/segment_store.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

constexpr std::uint64_t kOneSecond = 1'000'000'000, kStart = 1'760'000'000 * kOneSecond;

// Writing beyond `bytes` of a file fails with EFBIG, as a full disk fails with ENOSPC.
class NoRoomBeyond {
 public:
  explicit NoRoomBeyond(rlim_t bytes) : old_handler_(std::signal(SIGXFSZ, SIG_IGN)) {
    getrlimit(RLIMIT_FSIZE, &old_);
    const rlimit limit{bytes, old_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~NoRoomBeyond() {
    setrlimit(RLIMIT_FSIZE, &old_);
    std::signal(SIGXFSZ, old_handler_);
  }
  NoRoomBeyond(const NoRoomBeyond&) = delete;
  NoRoomBeyond& operator=(const NoRoomBeyond&) = delete;

 private:
  rlimit old_{};
  void (*old_handler_)(int);
};

class Store : public ::testing::Test {
 protected:
  StoreOptions options() const {
    StoreOptions options;
    options.folder = folder.path() / "recording";
    options.sync = false;
    return options;
  }
  std::vector<Record> all(Topic topic) const {
    std::vector<Record> found;
    for (const Segment& segment : segments_in(folder.path() / "recording")) {
      for (Record& record : test::read_back(segment.path).of(topic)) found.push_back(std::move(record));
    }
    return found;
  }
  std::size_t count(Stream stream) const {
    std::size_t found = 0;
    for (const Segment& segment : segments_in(folder.path() / "recording")) found += segment.stream == stream;
    return found;
  }
  ThumbnailRecord thumbnail(std::uint64_t index) const {
    Random random = Random(1).fork("thumbnail", index);
    ThumbnailRecord record{index, "frame.jpg", AnchorVerdict::ambiguous, Bytes(20'000), {}};
    for (std::uint8_t& byte : record.seen) byte = static_cast<std::uint8_t>(random.integer(0, 255));
    return record;
  }
  test::TemporaryFolder folder;
};

TEST_F(Store, ACleanEndIsTheLastRecordAndEverySegmentIsFinished) {
  SegmentStore store(options(), test::sample_session());
  for (std::uint64_t i = 0; i < 20; ++i) store.put(test::sample_estimate(i), kStart + i * kOneSecond / 3);
  store.put(thumbnail(0), kStart + 7 * kOneSecond);
  store.close("landed", kStart + 8 * kOneSecond);
  const auto segments = segments_in(folder / "recording");
  ASSERT_EQ(segments.size(), 2U);
  for (const Segment& segment : segments) {
    const auto back = test::read_back(segment.path);
    EXPECT_TRUE(back.contents.finished);
    EXPECT_TRUE(back.contents.findings.empty());
    EXPECT_EQ(back.records.front().first, Topic::session);
    EXPECT_EQ(std::get<SessionRecord>(back.records.front().second).segment, segment.number);
  }
  const auto back = test::read_back(segments[0].path);
  ASSERT_EQ(back.records.back().first, Topic::end);
  const auto& end = std::get<EndRecord>(back.records.back().second);
  EXPECT_TRUE(end.clean_shutdown);
  EXPECT_EQ(end.records, 21U);
  EXPECT_EQ(end.reason, "landed");
}

TEST_F(Store, ChunksReachTheDiskByTimeAndBySize) {
  StoreOptions small = options();
  small.chunk_bytes = 100'000;
  SegmentStore store(small, test::sample_session());
  store.put(test::sample_estimate(0), kStart);
  EXPECT_EQ(all(Topic::estimate).size(), 0U);
  store.tick(kStart + kOneSecond - 1);
  EXPECT_EQ(all(Topic::estimate).size(), 0U);
  store.tick(kStart + kOneSecond);
  EXPECT_EQ(all(Topic::estimate).size(), 1U);
  std::uint64_t i = 1;
  while (all(Topic::estimate).size() == 1U && i < 10'000) store.put(test::sample_estimate(i++), kStart + kOneSecond);
  EXPECT_GT(i, 100U);
  EXPECT_LT(i, 1000U);
}

TEST_F(Store, SegmentsRotateBySizeAndByTime) {
  StoreOptions small = options();
  small.segment_bytes = 100'000;
  small.segment_ns = 100 * kOneSecond;
  {
    SegmentStore store(small, test::sample_session());
    for (std::uint64_t i = 0; i < 30; ++i) store.put(thumbnail(i), kStart + i * 10 * kOneSecond);
    for (std::uint64_t i = 0; i < 30; ++i) store.put(test::sample_estimate(i), kStart + i * 10 * kOneSecond);
    store.close("", kStart + 300 * kOneSecond);
  }
  EXPECT_GE(count(Stream::thumbnails), 5U);
  EXPECT_EQ(count(Stream::flight), 3U);
  EXPECT_EQ(all(Topic::thumbnail).size(), 30U);
  EXPECT_EQ(all(Topic::estimate).size(), 30U);
}

TEST_F(Store, ARestartContinuesTheNumbers) {
  for (int flight = 0; flight < 3; ++flight) {
    SegmentStore store(options(), test::sample_session());
    store.put(test::sample_estimate(0), kStart);
    store.close("", kStart);
  }
  const auto segments = segments_in(folder / "recording");
  ASSERT_EQ(segments.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(segments[i].number, i + 1);
}

TEST_F(Store, RefusesASecondRecorderInTheFolder) {
  const SegmentStore store(options(), test::sample_session());
  EXPECT_THROW(SegmentStore(options(), test::sample_session()), Error);
}

TEST_F(Store, TheBudgetDropsThumbnailsBeforeFramesBeforeDecisions) {
  StoreOptions tight = options();
  tight.budget_bytes = std::uint64_t{2} << 20;
  tight.zstd_level = 0;
  SegmentStore store(tight, test::sample_session());
  Random random(2);
  FrameRecord picture{0, "frame.jpg", Bytes(20'000)};
  for (std::uint8_t& byte : picture.encoded) byte = static_cast<std::uint8_t>(random.integer(0, 255));
  for (std::uint64_t i = 0; i < 40; ++i) {
    store.put(thumbnail(i), kStart + i * kOneSecond);
    store.put(picture, kStart + i * kOneSecond);
    store.put(test::sample_estimate(i), kStart + i * kOneSecond);
  }
  ASSERT_EQ(store.status().deleted_segments, 0U);
  for (std::uint64_t i = 40; i < 90; ++i) {
    store.put(picture, kStart + i * kOneSecond);
    store.put(test::sample_estimate(i), kStart + i * kOneSecond);
  }
  store.flush(kStart + 90 * kOneSecond);
  EXPECT_GT(store.status().deleted_segments, 2U);
  EXPECT_LE(count(Stream::thumbnails), 1U);  // the open one
  EXPECT_EQ(all(Topic::estimate).size(), 90U);
  for (std::uint64_t i = 90; i < 300; ++i) store.put(picture, kStart + i * kOneSecond);
  store.close("", kStart + 300 * kOneSecond);
  std::uint64_t bytes = 0;
  for (const Segment& segment : segments_in(folder / "recording")) bytes += segment.bytes;
  EXPECT_LE(bytes, tight.budget_bytes + 36'000);  // and the footers of the last three, which hold the schemas
  EXPECT_EQ(all(Topic::estimate).size(), 90U);
  EXPECT_EQ(all(Topic::recorder).size(), store.status().deleted_segments);
}

TEST_F(Store, DecisionsAreDeletedLastOldestFirst) {
  StoreOptions tight = options();
  tight.budget_bytes = std::uint64_t{1} << 20;
  tight.zstd_level = 0;
  SegmentStore store(tight, test::sample_session());
  for (std::uint64_t i = 0; i < 8000; ++i) store.put(test::sample_estimate(i), kStart + i * kOneSecond / 10);
  store.close("", kStart + 800 * kOneSecond);
  const auto left = all(Topic::estimate);
  ASSERT_FALSE(left.empty());
  EXPECT_LT(left.size(), 8000U);
  EXPECT_EQ(std::get<EstimateRecord>(left.back()).index, 7999U);
  EXPECT_EQ(std::get<EstimateRecord>(left.front()).index, 8000U - left.size());  // no hole
}

TEST_F(Store, AFullDiskStopsRecordingAndRoomResumesIt) {
  SegmentStore store(options(), test::sample_session());
  store.put(test::sample_estimate(0), kStart);
  store.flush(kStart);
  const std::uint64_t size = segments_in(folder / "recording").front().bytes;
  std::uint64_t i = 1;
  {
    const NoRoomBeyond limit(size + 1000);
    for (; i < 300; ++i) store.put(test::sample_estimate(i), kStart + i * kOneSecond);
    EXPECT_TRUE(store.status().stopped);
    EXPECT_NE(store.status().error.find("000001.flight.mcap"), std::string::npos);
    // What is on the disk is sound.
    const auto back = test::read_back(segments_in(folder / "recording").front().path);
    EXPECT_FALSE(back.contents.findings.has_errors());
    EXPECT_GE(back.of(Topic::estimate).size(), 1U);
  }
  for (; i < 310; ++i) store.put(test::sample_estimate(i), kStart + i * kOneSecond);
  EXPECT_FALSE(store.status().stopped);
  EXPECT_TRUE(store.status().error.empty());
  store.close("", kStart + 310 * kOneSecond);
  EXPECT_EQ(all(Topic::estimate).size(), 310U);  // they waited in memory
  const auto events = all(Topic::recorder);
  ASSERT_EQ(events.size(), 2U);
  EXPECT_EQ(std::get<RecorderRecord>(events[0]).kind, RecorderEventKind::stopped);
  EXPECT_EQ(std::get<RecorderRecord>(events[1]).kind, RecorderEventKind::resumed);
}

TEST_F(Store, WhatDoesNotFitInMemoryIsCountedAndTheCountRecorded) {
  StoreOptions small = options();
  small.waiting_bytes = 50'000;
  SegmentStore store(small, test::sample_session());
  store.put(test::sample_estimate(0), kStart);
  store.flush(kStart);
  {
    const NoRoomBeyond limit(100);
    for (std::uint64_t i = 1; i < 2000; ++i) store.put(test::sample_estimate(i), kStart + i * kOneSecond);
    EXPECT_GT(store.status().dropped.at(Topic::estimate), 1000U);
  }
  for (std::uint64_t i = 2000; i < 2010; ++i) store.put(test::sample_estimate(i), kStart + i * kOneSecond);
  store.close("", kStart + 2010 * kOneSecond);
  std::uint64_t dropped = 0;
  for (const Record& event : all(Topic::recorder)) {
    const auto& record = std::get<RecorderRecord>(event);
    if (record.kind == RecorderEventKind::dropped_by_disk) dropped += record.count;
  }
  EXPECT_EQ(dropped + all(Topic::estimate).size(), 2010U);
}

TEST_F(Store, NoRoomForTheFirstSegmentIsSurvived) {
  SegmentStore store(options(), test::sample_session());
  {
    const NoRoomBeyond limit(0);
    for (std::uint64_t i = 0; i < 10; ++i) store.put(test::sample_estimate(i), kStart + i * kOneSecond);
    EXPECT_TRUE(store.status().stopped);
    EXPECT_TRUE(segments_in(folder / "recording").empty());
  }
  store.put(test::sample_estimate(10), kStart + 10 * kOneSecond);
  store.close("", kStart + 11 * kOneSecond);
  EXPECT_FALSE(store.status().stopped);
  EXPECT_EQ(all(Topic::estimate).size(), 1U);
  EXPECT_EQ(all(Topic::end).size(), 1U);
}

TEST_F(Store, RefusesATooSmallBudget) {
  StoreOptions tiny = options();
  tiny.budget_bytes = 1000;
  EXPECT_THROW(SegmentStore(tiny, test::sample_session()), UsageError);
}

TEST_F(Store, OtherFilesAreLeftAlone) {
  std::filesystem::create_directories(folder / "recording");
  for (const char* name : {"notes.txt", "000000.flight.mcap", "1.other.mcap", "x.flight.mcap", "12.flight.mcap.bak"}) {
    write_file_atomic(folder / "recording" / name, std::string_view("mine"));
  }
  EXPECT_TRUE(segments_in(folder / "recording").empty());
}

// A file that somebody put there: its number plus one is none, and the next segment would have been number 0, then 1.
TEST_F(Store, AFileOfTheLargestNumberDoesNotWrapTheCounter) {
  std::filesystem::create_directories(folder / "recording");
  folder.write("recording/4294967295.flight.mcap", "");
  folder.write("recording/1000000001.flight.mcap", "");
  folder.write("recording/000041.flight.mcap", "");
  const auto segments = segments_in(folder / "recording");
  ASSERT_EQ(segments.size(), 1U);
  EXPECT_EQ(segments.front().number, 41U);
}

}  // namespace
}  // namespace nadir
