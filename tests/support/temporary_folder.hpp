// A folder of its own for a test; removed with everything in it at the end.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace nadir::test {

class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path operator/(std::string_view name) const { return path_ / name; }
  std::filesystem::path write(std::string_view name, std::string_view text) const;  // returns the file's path

 private:
  std::filesystem::path path_;
};

}  // namespace nadir::test
