// A file that only grows, and only by whole pieces: a piece that does not fit on the disk leaves no trace.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "base/bytes.hpp"

namespace nadir {

// Where a segment's bytes go. append() returns false, and the place keeps what it had, when there is no room.
class McapSink {
 public:
  virtual ~McapSink() = default;
  virtual bool append(ByteView bytes) = 0;
};

class SegmentFile final : public McapSink {
 public:
  // Makes the file; ok() is false when that cannot be done or the name is taken (error() says which).
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
  bool sync_;  // to the disk after each piece: what is written survives the loss of power
  int fd_ = -1;
  int error_ = 0;
  std::uint64_t size_ = 0;
};

}  // namespace nadir
