// The flight recorder: takes records from any thread and writes them to disk on its own thread.
//
// record() never waits for the disk: it puts the record into a queue of bounded size. When that is full, thumbnails go
// first, then kept pictures, then what has just come; each loss is counted, and the losses are recorded. Nothing that
// happens to the disk ends or delays the flight; status() reports it.
//
// Threads: record(), offer_thumbnail() and status() from any thread; the segments belong to the recorder's thread
// alone. The clock is called from all of them.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <thread>
#include <variant>

#include "recorder/records.hpp"
#include "recorder/segment_store.hpp"

namespace nadir {

using NanosecondClock = std::function<std::uint64_t()>;  // since 1970, UTC

enum class WhenFull {
  drop,  // in flight
  wait,  // in a replay, which has time
};

struct RecorderOptions {
  StoreOptions store;
  std::size_t queue_bytes = std::size_t{32} << 20;
  WhenFull when_full = WhenFull::drop;
  bool keep_pictures = false;                   // images too; otherwise frames are recorded by name and digest
  std::uint64_t thumbnail_ns = 10'000'000'000;  // least time between two
};

// Images that the recorder's thread scales down and encodes. They must not be modified any more.
struct ThumbnailImages {
  std::uint64_t index = 0;
  std::string frame;
  AnchorVerdict verdict = AnchorVerdict::not_tried;
  cv::Mat seen, map;  // map may be empty
};

class Recorder {
 public:
  // Throws Error when the folder cannot be made or another recorder is at it.
  Recorder(RecorderOptions options, SessionRecord session, NanosecondClock clock);
  ~Recorder();  // without close(): everything is written, but the end is not called clean
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  void record(Record record);
  // Recorded when the last one is long enough ago.
  void offer_thumbnail(ThumbnailImages pictures);
  bool keeps_pictures() const { return options_.keep_pictures; }

  // Waits until all that was recorded before has been handed to the disk, or dropped.
  void flush();
  // The orderly end. Nothing is recorded after it.
  void close(const std::string& reason);

  StoreStatus status() const;

 private:
  struct Item {
    std::variant<Record, ThumbnailImages> what;
    std::uint64_t at_ns = 0;
    std::size_t bytes = 0;

    Topic topic() const;
  };

  void push(Item item);
  bool make_room(const Item& item);
  void run();
  void write(const Item& item);
  void publish();

  RecorderOptions options_;
  NanosecondClock clock_;
  SegmentStore store_;  // the thread's, until it has ended

  mutable std::mutex mutex_;
  std::condition_variable work_, progress_;
  std::deque<Item> queue_;
  std::size_t queued_bytes_ = 0;            // with the one that is being written
  std::map<Topic, std::uint64_t> dropped_;  // not yet reported to the store
  std::uint64_t flush_wanted_ = 0, flushed_ = 0;
  std::optional<std::uint64_t> last_thumbnail_ns_;
  std::optional<std::string> closing_;  // the reason
  bool stopping_ = false;
  StoreStatus status_;
  std::thread thread_;  // last: it uses everything above
};

// The results of a frame: its estimate, its anchor attempt if there was one, and a thumbnail of an attempt that failed.
void record_frame(Recorder& recorder, std::uint64_t index, const FrameReport& report);

// An attempt that was looked up while further frames were followed: of the frame `index`, taken in after the frame
// `taken_after`, and the estimate that it led to, another one of that frame. A look that failed (not_tried) is recorded
// as well: the localizer may look again only when it is back.
void record_anchor(Recorder& recorder, std::uint64_t index, std::uint64_t taken_after, const FrameReport& report);

// The input of the localizer. encoded: the frame's image, recorded when keep_pictures is set.
void record_input(Recorder& recorder, std::uint64_t index, const Telemetry& telemetry, ByteView encoded);

}  // namespace nadir
