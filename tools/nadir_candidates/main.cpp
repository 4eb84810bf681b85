#include <sys/ioctl.h>
#include <unistd.h>

#include <iostream>

#include "nadir_candidates/commands.hpp"
#include "cli/terminal.hpp"
#include "cli/program.hpp"

int main(int argc, char** argv) {
  nadir::install_signal_handlers();
  const nadir::SystemClock clock;
  std::vector<std::unique_ptr<nadir::Command>> commands;
  commands.push_back(std::make_unique<nadir::ServeCommand>());
  commands.push_back(std::make_unique<nadir::StatusCommand>());
  commands.push_back(std::make_unique<nadir::ExportCommand>());
  const nadir::ProgramText text{
      .name = "nadir-candidates",
      .summary = "stores tiles from flights and promotes those that independent flights agree on",
      .footer = "See docs/commands/ for a page per command."};
  winsize size{};
  const bool terminal = isatty(STDERR_FILENO) == 1;
  const bool sized = terminal && ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0;
  return nadir::run_program(text, commands, {argv + 1, argv + argc},
                            {std::cout, std::cerr, clock, terminal, sized ? size.ws_col : 80});
}
