// Records into the segments of a folder: chunks by size and time, a new segment by size and time, a budget for the
// folder, and a full disk survived.
//
// Used by one thread. Disk errors never throw: status() reports them, and the recording does once there is room
// again. Time comes in with each call (nanoseconds since 1970).
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "recorder/mcap_writer.hpp"
#include "recorder/records.hpp"
#include "recorder/segments.hpp"

namespace nadir {

struct StoreOptions {
  std::filesystem::path folder;
  std::size_t chunk_bytes = std::size_t{512} << 10;
  std::uint64_t chunk_ns = 1'000'000'000;            // what a kill can cost
  std::size_t waiting_bytes = std::size_t{8} << 20;  // kept of a stream while the disk is full
  std::uint64_t segment_bytes = std::uint64_t{64} << 20;
  std::uint64_t segment_ns = 600'000'000'000;
  std::uint64_t budget_bytes = std::uint64_t{8} << 30;  // of the folder
  bool sync = true;                                     // chunks survive the loss of power
  int zstd_level = 1;
};

struct StoreStatus {
  std::uint64_t records = 0;     // accepted, written or still in a chunk
  std::uint64_t bytes = 0;       // of the folder
  std::uint64_t free_bytes = 0;  // of its disk
  std::map<Topic, std::uint64_t> dropped;
  std::uint64_t segments = 0, deleted_segments = 0;
  bool stopped = false;  // nothing can be written at present
  std::string error;     // why
};

class SegmentStore {
 public:
  // Takes the folder for itself. Throws Error when it cannot be made, or another recorder is at it.
  SegmentStore(StoreOptions options, SessionRecord session);
  ~SegmentStore();  // finishes what is open, without an end record
  SegmentStore(const SegmentStore&) = delete;
  SegmentStore& operator=(const SegmentStore&) = delete;

  void put(const Record& record, std::uint64_t at_ns);
  void tick(std::uint64_t now_ns);   // what is due
  void flush(std::uint64_t now_ns);  // all chunks, now
  // The orderly end: the last record, and every segment finished.
  void close(const std::string& reason, std::uint64_t now_ns);

  // Counts records that were dropped before put(); the recording reports them.
  void count_dropped(RecorderEventKind kind, Topic topic, std::uint64_t count);

  const StoreStatus& status() const { return status_; }

 private:
  struct Open {
    std::unique_ptr<SegmentFile> file;
    std::unique_ptr<McapWriter> writer;
    std::uint32_t number = 0;
    std::uint64_t since_ns = 0, chunk_since_ns = 0, next_try_ns = 0;
  };

  void write(const Record& record, std::uint64_t at_ns);
  void write_events(std::uint64_t now_ns);
  bool open(Stream stream, std::uint64_t now_ns);
  void write_chunk(Stream stream, std::uint64_t now_ns);
  void finish(Stream stream);
  void leave(Stream stream, bool keep);
  bool make_room(Stream stream);
  void keep_budget();
  void remove(std::vector<Segment>::const_iterator segment);
  void failed(const SegmentFile& file);
  void drop_chunk(Open& open);
  std::uint64_t folder_bytes() const;
  void measure();

  StoreOptions options_;
  SessionRecord session_;
  int folder_lock_ = -1;
  std::map<Stream, Open> open_;
  std::map<Stream, std::uint64_t> next_open_ns_;  // after one that could not be opened
  std::vector<Segment> closed_;
  std::uint32_t next_number_ = 1;
  std::map<Topic, std::uint32_t> sequence_;
  std::map<std::pair<RecorderEventKind, Topic>, std::uint64_t> unreported_drops_;
  std::vector<RecorderRecord> pending_events_;
  StoreStatus status_;
};

}  // namespace nadir
