// Results as lines of text that survive a kill: a restarted run continues after the last complete line.
#pragma once

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace nadir::bench {

class ResultsFile {
 public:
  // header: the file's first lines, which identify the run. An empty path keeps nothing. Throws UsageError
  // when the file belongs to another run.
  ResultsFile(const std::filesystem::path& path, const std::string& header);

  const std::vector<std::string>& lines() const { return lines_; }  // that were there, without the header
  void append(const std::string& line) { out_ << line << std::flush; }

 private:
  std::vector<std::string> lines_;
  std::ofstream out_;
};

}  // namespace nadir::bench
