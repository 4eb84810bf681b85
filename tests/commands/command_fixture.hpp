// The commands of `nadir` as a user calls them, in a folder of the test's own: exit code, stdout, stderr.
#pragma once

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "cli/program.hpp"
#include "commands/commands.hpp"
#include "package/package_maker.hpp"
#include "support/temporary_folder.hpp"

namespace nadir::test {

class CommandTest : public ::testing::Test {
 protected:
  // `nadir ARGS`; "@name" is the path of a name in the test's folder.
  int run(std::vector<std::string> args) {
    for (std::string& arg : args) {
      if (arg.starts_with('@')) arg = path(arg.substr(1));
    }
    out_.str("");
    err_.str("");
    return run_program(nadir_text(), all_commands(), args, {out_, err_, clock_});
  }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  nlohmann::json result() const { return nlohmann::json::parse(out_.str()); }

  TemporaryFolder folder_;
  FixedClock clock_{kJudged};
  std::ostringstream out_, err_;
  PackageMaker maker_;
};

}  // namespace nadir::test
