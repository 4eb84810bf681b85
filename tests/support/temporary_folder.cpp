#include "support/temporary_folder.hpp"

#include <stdlib.h>

#include <fstream>

#include "base/error.hpp"

namespace nadir::test {

TemporaryFolder::TemporaryFolder() {
  std::string pattern = std::filesystem::temp_directory_path() / "nadir-test-XXXXXX";
  if (::mkdtemp(pattern.data()) == nullptr) throw Error({.what = "cannot create a temporary folder"});
  path_ = pattern;
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

std::filesystem::path TemporaryFolder::write(std::string_view name, std::string_view text) const {
  const auto file = path_ / name;
  std::filesystem::create_directories(file.parent_path());
  std::ofstream(file, std::ios::binary) << text;
  return file;
}

}  // namespace nadir::test
