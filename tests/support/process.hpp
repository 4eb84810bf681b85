// Runs a program as a user would: arguments, exit code, what it wrote where.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace nadir::test {

struct ProcessResult {
  int code = -1;  // exit code; 128 + signal when it was killed
  std::string out;
  std::string err;
};

// args[0] is the program, looked up in PATH. Standard input is empty.
ProcessResult run_process(const std::vector<std::string>& args);

// A line of bash, for oracles such as `openssl dgst`.
ProcessResult run_shell(const std::string& line);

}  // namespace nadir::test
