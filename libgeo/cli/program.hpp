// The program around the commands: finds the one that is asked for, parses its options, runs it, and turns whatever
// happens into a message and an exit code. main() and the tests call it alike.
#pragma once

#include <iosfwd>
#include <memory>
#include <string>
#include <vector>

#include "cli/command.hpp"
#include "cli/terminal.hpp"

namespace nadir {

struct ProgramText {
  std::string name;  // "nadir"
  std::string summary;
  std::string footer;
};

// What the program gets from outside.
struct Environment {
  std::ostream& out;
  std::ostream& err;
  const Clock& clock;
  ProgressStyle progress = ProgressStyle::none;  // on err
  int err_columns = 80;
};

// The style that suits: lines of JSON where the environment variable NADIR_PROGRESS is "json", a bar on a terminal.
ProgressStyle progress_style(bool err_is_terminal);

// args: without the program's own name. Never throws.
int run_program(const ProgramText& text, const std::vector<std::unique_ptr<Command>>& commands,
                const std::vector<std::string>& args, const Environment& environment);

// The same for a program that has one job and no command words.
int run_single_command(const std::string& name, Command& command, const std::vector<std::string>& args,
                       const Environment& environment);

}  // namespace nadir
