// The folder of a service, held by one process at a time.
#pragma once

#include <filesystem>

namespace nadir {

class DataFolder {
 public:
  // Makes it where it is missing. Throws Error when another process holds it.
  explicit DataFolder(const std::filesystem::path& path);
  ~DataFolder();
  DataFolder(const DataFolder&) = delete;
  DataFolder& operator=(const DataFolder&) = delete;

 private:
  int lock_ = -1;
};

}  // namespace nadir
