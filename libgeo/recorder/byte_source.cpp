#include "recorder/byte_source.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>

#include "base/error.hpp"

namespace nadir {

bool MemorySource::read(std::uint64_t offset, std::uint64_t count, Bytes& into) const {
  into.clear();
  if (offset > bytes_.size() || count > bytes_.size() - offset) return false;
  const ByteView piece = bytes_.subspan(static_cast<std::size_t>(offset), static_cast<std::size_t>(count));
  into.assign(piece.begin(), piece.end());
  return true;
}

FileSource::FileSource(const std::filesystem::path& path) : fd_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
  struct stat info {};
  if (fd_ < 0 || ::fstat(fd_, &info) != 0) {
    const int error_number = errno;
    if (fd_ >= 0) ::close(fd_);
    throw Error({.what = "cannot open", .where = path, .found = system_error_text(error_number)});
  }
  if (!S_ISREG(info.st_mode)) {
    ::close(fd_);
    throw Error({.what = "not a file", .where = path, .expected = "a regular file", .found = "a folder or device"});
  }
  size_ = static_cast<std::uint64_t>(info.st_size);
}

FileSource::~FileSource() { ::close(fd_); }

bool FileSource::read(std::uint64_t offset, std::uint64_t count, Bytes& into) const {
  into.clear();
  if (offset > size_ || count > size_ - offset) return false;
  into.resize(static_cast<std::size_t>(count));
  std::uint64_t done = 0;
  while (done < count) {
    const ssize_t got =
        ::pread(fd_, into.data() + done, static_cast<std::size_t>(count - done), static_cast<off_t>(offset + done));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) {
      into.clear();
      return false;
    }
    done += static_cast<std::uint64_t>(got);
  }
  return true;
}

}  // namespace nadir
