// For readers that take a path: the bytes in a file of a folder of this process (TMPDIR=/dev/shm makes that fast).
#pragma once

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string_view>

#include "base/error.hpp"
#include "support/temporary_folder.hpp"

namespace nadir::fuzz {

inline const test::TemporaryFolder& scratch_folder() {
  static const test::TemporaryFolder folder;
  return folder;
}

inline std::filesystem::path scratch_file(std::string_view name, std::string_view bytes) {
  const std::filesystem::path path = scratch_folder() / name;
  std::ofstream(path, std::ios::binary | std::ios::trunc)
      .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  return path;
}

inline void require(bool holds, const char* what) {
  if (holds) return;
  std::fprintf(stderr, "broken: %s\n", what);
  std::abort();
}

// The reader's own error; anything else terminates the program.
template <typename Work>
void refusing(const Work& work) {
  try {
    work();
  } catch (const Error&) {
  }
}

}  // namespace nadir::fuzz
