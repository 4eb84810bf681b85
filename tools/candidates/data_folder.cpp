#include "candidates/data_folder.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>

#include "base/error.hpp"

namespace nadir {

DataFolder::DataFolder(const std::filesystem::path& path) {
  std::error_code code;
  std::filesystem::create_directories(path, code);
  if (code) throw Error({.what = "the service's folder cannot be made", .where = path, .found = code.message()});
  lock_ = ::open((path / ".lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (lock_ < 0) {
    throw Error({.what = "the service's folder cannot be written", .where = path, .found = system_error_text(errno)});
  }
  if (::flock(lock_, LOCK_EX | LOCK_NB) != 0) {
    ::close(lock_);
    throw Error(
        {.what = "another service works in this folder", .where = path, .fix = "end it first, or use another --data"});
  }
}

DataFolder::~DataFolder() { ::close(lock_); }

}  // namespace nadir
