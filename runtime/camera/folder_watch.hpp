// Which files of a folder were finished since the last look: closed after writing, or moved in. inotify(7), as values.
#pragma once

#include <chrono>
#include <filesystem>
#include <stop_token>
#include <string>
#include <vector>

namespace nadir {

struct FolderNews {
  std::vector<std::string> finished;  // names, in the order in which they were finished
  bool overflowed = false;            // some were lost: look for yourself
  bool gone = false;                  // the folder was deleted, moved away or unmounted; watch anew
};

class FolderWatch {
 public:
  // Throws Error when the folder cannot be watched.
  explicit FolderWatch(const std::filesystem::path& folder);
  ~FolderWatch();
  FolderWatch(const FolderWatch&) = delete;
  FolderWatch& operator=(const FolderWatch&) = delete;

  // What has come; waits for it at most so long, or until stop.
  FolderNews wait(std::chrono::milliseconds at_most, const std::stop_token& stop);

 private:
  int events_ = -1;
  int wake_ = -1;
};

}  // namespace nadir
