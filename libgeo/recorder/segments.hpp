// The segments of a folder, NNNNNN.flight.mcap, NNNNNN.pictures.mcap and NNNNNN.thumbnails.mcap, and the file that one
// is written to. Numbers grow in the order in which the files were created, across restarts; they do not depend on the
// clock.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "base/bytes.hpp"
#include "recorder/mcap_writer.hpp"
#include "recorder/records.hpp"

namespace nadir {

struct Segment {
  std::filesystem::path path;
  std::uint32_t number = 0;
  Stream stream = Stream::flight;
  std::uint64_t bytes = 0;
};

std::filesystem::path segment_path(const std::filesystem::path& folder, std::uint32_t number, Stream stream);

// By number. Other files are left out. Throws Error when the folder cannot be read.
std::vector<Segment> segments_in(const std::filesystem::path& folder);

// The segment to delete when there are too many: thumbnails before pictures before decisions, the oldest first.
// up_to: streams beyond this one are kept. end(): none.
std::vector<Segment>::const_iterator most_expendable(const std::vector<Segment>& segments, Stream up_to);

// An append-only file with atomic writes: a write that does not fit on the disk leaves no trace.
class SegmentFile final : public McapSink {
 public:
  // Creates the file; ok() is false when that fails or the file exists (see error()).
  SegmentFile(std::filesystem::path path, bool sync);
  ~SegmentFile() override;
  SegmentFile(const SegmentFile&) = delete;
  SegmentFile& operator=(const SegmentFile&) = delete;

  bool ok() const { return fd_ >= 0; }
  bool append(ByteView bytes) override;
  bool sync();  // everything to the disk, now

  const std::filesystem::path& path() const { return path_; }
  std::uint64_t size() const { return size_; }
  int error() const { return error_; }  // errno of what failed last

 private:
  std::filesystem::path path_;
  bool sync_;  // sync after each write: survives a power loss
  int fd_ = -1;
  int error_ = 0;
  std::uint64_t size_ = 0;
};

}  // namespace nadir
