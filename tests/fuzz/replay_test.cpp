// The corpus with every compiler: as it is, cut short everywhere, and with a bit flipped everywhere. Whatever fuzzing
// finds is added to the corpus and so stays found. What lies in a folder TARGET/reached was found by libFuzzer to cover
// the reader's code, or is one case among many: replayed as it is.
#include <gtest/gtest.h>

#include "base/files.hpp"
#include "fuzz/targets.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;

class Fuzz : public ::testing::TestWithParam<fuzz::Target> {
 protected:
  static std::vector<fs::path> files_in(const fs::path& folder) {
    std::vector<fs::path> files;
    if (!fs::is_directory(folder)) return files;
    for (const auto& entry : fs::directory_iterator(folder)) {
      if (entry.is_regular_file()) files.push_back(entry.path());
    }
    return files;
  }
  static fs::path folder() { return fs::path(NADIR_FUZZ_CORPUS) / GetParam().name; }
  static std::vector<fs::path> corpus() { return files_in(folder()); }
  static std::vector<fs::path> reached() { return files_in(folder() / "reached"); }
};

TEST_P(Fuzz, ReplaysTheCorpus) {
  ASSERT_GE(corpus().size(), 3U);
  for (const fs::path& file : corpus()) {
    SCOPED_TRACE(file);
    GetParam().run(read_text_file(file));
  }
  for (const fs::path& file : reached()) {
    SCOPED_TRACE(file);
    GetParam().run(read_text_file(file));
  }
}

TEST_P(Fuzz, StandsCutsAndFlips) {
  for (const fs::path& file : corpus()) {
    SCOPED_TRACE(file);
    const std::string whole = read_text_file(file);
    const std::size_t step = 1 + whole.size() / 200;
    for (std::size_t at = 0; at < whole.size(); at += step) {
      GetParam().run(std::string_view(whole).substr(0, at));
      std::string flipped = whole;
      flipped[at] = static_cast<char>(flipped[at] ^ (1 << (at / step % 7)));
      GetParam().run(flipped);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, Fuzz, ::testing::ValuesIn(fuzz::targets()),
                         [](const auto& target) { return std::string(target.param.name); });

}  // namespace
}  // namespace nadir
