// A lock on an open file or folder that several processes write to (flock), for as long as this lives. One that hangs
// with it must not hang the others: they wait for so long and then say which file it is and what to do.
#pragma once

#include <chrono>
#include <filesystem>
#include <string>

namespace nadir {

class FileLock {
 public:
  // fd stays the caller's and open. what: names the file in errors, as in "the audit log". Throws Error where another
  // process keeps the lock for longer, or the file system has none.
  FileLock(int fd, std::chrono::milliseconds patience, const std::string& what, const std::filesystem::path& path);
  ~FileLock();
  FileLock(const FileLock&) = delete;
  FileLock& operator=(const FileLock&) = delete;

 private:
  int fd_;
};

}  // namespace nadir
