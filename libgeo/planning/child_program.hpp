// Runs a program and reads what it says while it works.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace nadir {

struct ProgramCall {
  std::vector<std::string> words;                                  // the program's path and its arguments
  std::filesystem::path folder;                                    // where it runs
  std::vector<std::pair<std::string, std::string>> environment{};  // added to ours
};

struct ProgramResult {
  int exit_code = 0;  // 128 + the signal that ended it
  std::string out;    // standard output, at most kMaxProgramOutput bytes
};

inline constexpr std::size_t kMaxProgramOutput = std::size_t{16} << 20;

// on_error_line: each line of standard error, without its end. stopped: asked ten times a second; once it says true the
// program gets SIGTERM, and SIGKILL when it has not ended ten seconds later. It also gets SIGTERM when the calling
// thread ends. Throws Error when it cannot be started.
ProgramResult run_program_call(const ProgramCall& call, const std::function<void(std::string_view)>& on_error_line,
                               const std::function<bool()>& stopped);

}  // namespace nadir
