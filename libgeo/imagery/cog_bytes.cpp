#include "imagery/cog_bytes.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>

#include "imagery/cog_error.hpp"

namespace nadir {

FileBytes::FileBytes(std::filesystem::path path) : path_(std::move(path)) {
  // Without blocking: a pipe of this name must not make us wait for a writer.
  fd_ = ::open(path_.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (fd_ < 0) {
    throw Error({.what = "cannot open the tile set",
                 .where = path_.string(),
                 .found = system_error_text(errno),
                 .fix = "check the path and its permissions"});
  }
  struct stat info {};
  const bool regular = ::fstat(fd_, &info) == 0 && S_ISREG(info.st_mode);
  if (!regular) {
    ::close(fd_);
    throw Error({.what = "the tile set is not a file", .where = path_.string(), .expected = "a GeoTIFF"});
  }
  size_ = static_cast<std::uint64_t>(info.st_size);
}

FileBytes::~FileBytes() { ::close(fd_); }

bool FileBytes::read(std::uint64_t at, std::span<std::uint8_t> target) const {
  if (at > size_ || target.size() > size_ - at) return false;
  for (std::size_t have = 0; have < target.size();) {
    const ssize_t got = ::pread(fd_, target.data() + have, target.size() - have, static_cast<off_t>(at + have));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) {
      throw CogError("tiff.corrupt", {.what = "cannot read the tile set",
                                      .where = path_.string(),
                                      .found = system_error_text(errno),
                                      .fix = "check the medium that it lies on"});
    }
    if (got == 0) return false;
    have += static_cast<std::size_t>(got);
  }
  return true;
}

bool MemoryBytes::read(std::uint64_t at, std::span<std::uint8_t> target) const {
  if (at > bytes_.size() || target.size() > bytes_.size() - at) return false;
  std::copy_n(bytes_.begin() + static_cast<std::ptrdiff_t>(at), target.size(), target.begin());
  return true;
}

}  // namespace nadir
