#include "recorder/segment_file.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>

namespace nadir {

SegmentFile::SegmentFile(std::filesystem::path path, bool sync) : path_(std::move(path)), sync_(sync) {
  fd_ = ::open(path_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644);
  if (fd_ < 0) error_ = errno;
}

SegmentFile::~SegmentFile() {
  if (fd_ >= 0) ::close(fd_);
}

bool SegmentFile::sync() {
  if (::fsync(fd_) == 0) return true;
  error_ = errno;
  return false;
}

bool SegmentFile::append(ByteView bytes) {
  if (fd_ < 0) return false;
  std::uint64_t at = size_;
  while (!bytes.empty()) {
    const ssize_t written = ::pwrite(fd_, bytes.data(), bytes.size(), static_cast<off_t>(at));
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) {
      error_ = written < 0 ? errno : ENOSPC;
      // Cutting needs no room. Should it fail all the same, the next piece is written over the torn one.
      static_cast<void>(::ftruncate(fd_, static_cast<off_t>(size_)) == 0);
      return false;
    }
    at += static_cast<std::uint64_t>(written);
    bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
  if (sync_ && ::fdatasync(fd_) != 0) {
    // Some file systems find out only now that there is no room.
    error_ = errno;
    static_cast<void>(::ftruncate(fd_, static_cast<off_t>(size_)) == 0);
    return false;
  }
  size_ = at;
  return true;
}

}  // namespace nadir
