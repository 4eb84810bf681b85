// A file system of a size of its own, for tests that fill it: a tmpfs, which only root may mount.
#pragma once

#include <unistd.h>

#include <filesystem>
#include <string>
#include <utility>

#include "support/process.hpp"

namespace nadir::test {

class SmallDisk {
 public:
  // folder: created. options: of mount, such as "size=600k".
  SmallDisk(std::filesystem::path folder, const std::string& options) : folder_(std::move(folder)) {
    std::filesystem::create_directory(folder_);
    mounted_ =
        ::geteuid() == 0 && run_process({"mount", "-t", "tmpfs", "-o", options, "tmpfs", folder_.string()}).code == 0;
  }
  ~SmallDisk() {
    if (mounted_) run_process({"umount", "-l", folder_.string()});
  }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;

  bool mounted() const { return mounted_; }
  bool resize(const std::string& size) {
    return run_process({"mount", "-o", "remount,size=" + size, folder_.string()}).code == 0;
  }

 private:
  std::filesystem::path folder_;
  bool mounted_ = false;
};

}  // namespace nadir::test
