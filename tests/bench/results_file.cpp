#include "results_file.hpp"

#include "base/error.hpp"
#include "base/files.hpp"

namespace nadir::bench {

ResultsFile::ResultsFile(const std::filesystem::path& path, const std::string& header) {
  if (path.empty()) return;
  if (!std::filesystem::exists(path)) write_file_atomic(path, header);
  const std::string text = read_text_file(path);
  if (!text.starts_with(header)) {
    throw UsageError({.what = "the file holds no results of this run",
                      .where = path.string(),
                      .expected = header.substr(0, header.find('\n')),
                      .found = text.substr(0, text.find('\n')),
                      .fix = "name another file, or pass the --seed of its run"});
  }
  std::size_t at = header.size();
  for (std::size_t end = 0; (end = text.find('\n', at)) != std::string::npos; at = end + 1) {
    lines_.push_back(text.substr(at, end - at));
  }
  if (at < text.size()) write_file_atomic(path, text.substr(0, at));  // an incomplete line after a kill
  out_.open(path, std::ios::app);
}

}  // namespace nadir::bench
