// The recorder with its thread. The clock stands where the test puts it; what is awaited is awaited with flush().
#include "recorder/recorder.hpp"

#include <gtest/gtest.h>

#include <atomic>

#include "base/error.hpp"
#include "imagery/codecs.hpp"
#include "recorder/sample_records.hpp"
#include "support/temporary_folder.hpp"

namespace nadir {
namespace {

constexpr std::uint64_t kSecond = 1'000'000'000;

class RecorderThread : public ::testing::Test {
 protected:
  RecorderOptions options() const {
    RecorderOptions options;
    options.store.folder = folder.path();
    options.store.sync = false;
    return options;
  }
  NanosecondClock clock() {
    return [this] { return now_ns.load(); };
  }
  std::vector<Record> all(Topic topic) const {
    std::vector<Record> found;
    for (const Segment& segment : segments_in(folder.path())) {
      for (Record& record : test::read_back(segment.path).of(topic)) found.push_back(std::move(record));
    }
    return found;
  }
  // Holds up the recorder's thread: the clock that it asks does not answer before release().
  class Hold {
   public:
    std::uint64_t ask() {
      if (std::this_thread::get_id() == tester_) return kSecond;
      asked_ = true;
      asked_.notify_all();
      held_.wait(true);
      return kSecond;
    }
    void await() { asked_.wait(false); }
    void release() {
      held_ = false;
      held_.notify_all();
    }

   private:
    std::thread::id tester_ = std::this_thread::get_id();
    std::atomic<bool> asked_{false}, held_{true};
  };
  static FrameReport refused(int frame) {
    FrameReport report;
    report.estimate = test::sample_estimate(static_cast<std::uint64_t>(frame)).estimate;
    report.anchor.verdict = AnchorVerdict::ambiguous;
    report.anchor.rectified = cv::Mat(600, 800, CV_8UC1, cv::Scalar(frame % 256));
    report.anchor.matched_map = cv::Mat(600, 800, CV_8UC3, cv::Scalar(1, 2, 3));
    return report;
  }

  test::TemporaryFolder folder;
  std::atomic<std::uint64_t> now_ns{1'760'000'000 * kSecond};
};

TEST_F(RecorderThread, RecordsOfManyThreadsAllArrive) {
  {
    Recorder recorder(options(), test::sample_session(), clock());
    std::vector<std::jthread> threads;
    for (std::uint64_t t = 0; t < 4; ++t) {
      threads.emplace_back([&recorder, this, t] {
        for (std::uint64_t i = 0; i < 200; ++i) {
          recorder.record(test::sample_estimate(t * 1000 + i));
          now_ns += 1000;
          static_cast<void>(recorder.status());
        }
      });
    }
    threads.clear();
    recorder.close("done");
    EXPECT_EQ(recorder.status().records, 801U);  // and the end
  }
  EXPECT_EQ(all(Topic::estimate).size(), 800U);
  EXPECT_EQ(all(Topic::end).size(), 1U);
}

TEST_F(RecorderThread, WithoutCloseNothingIsLostButTheEndIsNotClean) {
  {
    Recorder recorder(options(), test::sample_session(), clock());
    for (std::uint64_t i = 0; i < 10; ++i) recorder.record(test::sample_estimate(i));
  }
  EXPECT_EQ(all(Topic::estimate).size(), 10U);
  EXPECT_TRUE(all(Topic::end).empty());
}

TEST_F(RecorderThread, FlushWritesEverythingToTheDisk) {
  Recorder recorder(options(), test::sample_session(), clock());
  for (std::uint64_t i = 0; i < 10; ++i) {
    recorder.record(test::sample_estimate(i));
    recorder.flush();
    EXPECT_EQ(all(Topic::estimate).size(), i + 1);
  }
}

TEST_F(RecorderThread, AFrameIsRecordedWithEstimateAnchorAndSomeThumbnails) {
  {
    Recorder recorder(options(), test::sample_session(), clock());
    for (int i = 0; i < 40; ++i) {
      record_frame(recorder, static_cast<std::uint64_t>(i), refused(i));
      now_ns += kSecond;
    }
    FrameReport untried;
    record_frame(recorder, 40, untried);
    recorder.close("");
  }
  EXPECT_EQ(all(Topic::estimate).size(), 41U);
  EXPECT_EQ(all(Topic::anchor).size(), 40U);
  const auto thumbnails = all(Topic::thumbnail);
  ASSERT_EQ(thumbnails.size(), 4U);  // one in ten seconds
  const auto& first = std::get<ThumbnailRecord>(thumbnails[1]);
  EXPECT_EQ(first.index, 10U);
  EXPECT_EQ(first.verdict, AnchorVerdict::ambiguous);
  const ImageInfo info = read_image_info(first.seen, "thumbnail");
  EXPECT_EQ(info.format, ImageFormat::jpeg);
  EXPECT_EQ(info.width, 320);
  EXPECT_EQ(info.height, 240);
}

TEST_F(RecorderThread, ALateAnchorGivesItsFrameASecondEstimateEvenWhenTheAttemptFailed) {
  {
    Recorder recorder(options(), test::sample_session(), clock());
    record_anchor(recorder, 3, 5, refused(3));
    record_anchor(recorder, 6, 8, FrameReport{});
    recorder.close("");
  }
  const auto anchors = all(Topic::anchor), estimates = all(Topic::estimate);
  ASSERT_EQ(anchors.size(), 2U);
  ASSERT_EQ(estimates.size(), 2U);
  EXPECT_EQ(std::get<AnchorRecord>(anchors[0]).index, 3U);
  EXPECT_EQ(std::get<AnchorRecord>(anchors[0]).taken_after, 5U);
  EXPECT_EQ(std::get<EstimateRecord>(estimates[0]).index, 5U);
  EXPECT_EQ(std::get<AnchorRecord>(anchors[1]).anchor.verdict, AnchorVerdict::not_tried);
  EXPECT_EQ(std::get<EstimateRecord>(estimates[1]).index, 8U);
}

TEST_F(RecorderThread, KeepsFrameImagesWhenConfigured) {
  for (const bool keep : {false, true}) {
    const test::TemporaryFolder other;
    RecorderOptions kept = options();
    kept.store.folder = other.path();
    kept.keep_pictures = keep;
    Recorder recorder(kept, test::sample_session(), clock());
    Telemetry telemetry;
    telemetry.frame = "a.jpg";
    record_input(recorder, 0, telemetry, as_bytes("picture bytes"));
    recorder.close("");
    std::vector<Record> pictures, inputs;
    for (const Segment& segment : segments_in(other.path())) {
      const auto back = test::read_back(segment.path);
      for (const Record& record : back.of(Topic::picture)) pictures.push_back(record);
      for (const Record& record : back.of(Topic::input)) inputs.push_back(record);
    }
    ASSERT_EQ(inputs.size(), 1U);
    EXPECT_EQ(std::get<InputRecord>(inputs[0]).picture, sha256(as_bytes("picture bytes")));
    ASSERT_EQ(pictures.size(), keep ? 1U : 0U);
    if (!keep) continue;
    EXPECT_EQ(as_text(std::get<FrameRecord>(pictures[0]).encoded), "picture bytes");
  }
}

TEST_F(RecorderThread, AFullQueueDropsThumbnailsFirstAndReportsIt) {
  RecorderOptions small = options();
  small.queue_bytes = 300'000;
  small.thumbnail_ns = 0;
  Hold hold;
  {
    Recorder recorder(small, test::sample_session(), [&] { return hold.ask(); });
    std::jthread flusher([&] { recorder.flush(); });
    hold.await();
    for (int i = 0; i < 3; ++i) {
      recorder.offer_thumbnail({0, "a.jpg", AnchorVerdict::ambiguous, cv::Mat(200, 300, CV_8UC1, cv::Scalar(9)), {}});
    }
    for (std::uint64_t i = 0; i < 400; ++i) recorder.record(test::sample_estimate(i));
    const auto dropped = recorder.status().dropped;
    EXPECT_EQ(dropped.at(Topic::thumbnail), 3U);
    EXPECT_EQ(dropped.at(Topic::estimate), 400U - 292U);  // 1 KiB each
    hold.release();
    flusher.join();
    recorder.close("");
  }
  EXPECT_EQ(all(Topic::estimate).size(), 292U);
  EXPECT_TRUE(all(Topic::thumbnail).empty());
  std::map<std::string, std::uint64_t> dropped_by_topic;
  for (const Record& event : all(Topic::recorder)) {
    const auto& record = std::get<RecorderRecord>(event);
    EXPECT_EQ(record.kind, RecorderEventKind::dropped_by_queue);
    dropped_by_topic[record.topic] += record.count;
  }
  EXPECT_EQ(dropped_by_topic["/thumbnail"], 3U);
  EXPECT_EQ(dropped_by_topic["/estimate"], 108U);
}

TEST_F(RecorderThread, AReplayWaitsInsteadOfLosing) {
  RecorderOptions small = options();
  small.queue_bytes = 5000;
  small.when_full = WhenFull::wait;
  {
    Recorder recorder(small, test::sample_session(), clock());
    for (std::uint64_t i = 0; i < 500; ++i) recorder.record(test::sample_estimate(i));
    recorder.close("");
  }
  EXPECT_EQ(all(Topic::estimate).size(), 500U);
}

TEST_F(RecorderThread, AnUnwritableFolderIsAnError) {
  RecorderOptions nowhere = options();
  nowhere.store.folder = folder.write("file", "") / "below";
  EXPECT_THROW(Recorder(nowhere, test::sample_session(), clock()), Error);
}

}  // namespace
}  // namespace nadir
