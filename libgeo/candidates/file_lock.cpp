#include "candidates/file_lock.hpp"

#include <sys/file.h>

#include <cerrno>
#include <thread>

#include "base/error.hpp"

namespace nadir {
namespace {

constexpr std::chrono::milliseconds kLockPoll{2};

}  // namespace

FileLock::FileLock(int fd, std::chrono::milliseconds patience, const std::string& what,
                   const std::filesystem::path& path)
    : fd_(fd) {
  const auto until = std::chrono::steady_clock::now() + patience;
  while (::flock(fd_, LOCK_EX | LOCK_NB) != 0) {
    if (errno != EWOULDBLOCK && errno != EINTR) {
      throw Error({.what = "cannot lock " + what,
                   .where = path,
                   .found = system_error_text(errno),
                   .fix = "keep it on a file system that has locks"});
    }
    if (std::chrono::steady_clock::now() >= until) {
      throw Error({.what = "cannot write " + what,
                   .where = path,
                   .found = "another process has had it locked for too long",
                   .fix = "`fuser -v` names the process: let it go on, or end it"});
    }
    std::this_thread::sleep_for(kLockPoll);
  }
}

FileLock::~FileLock() { ::flock(fd_, LOCK_UN); }

}  // namespace nadir
