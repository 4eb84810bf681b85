// nadir-candidates: the candidate service and its tools.
#include <malloc.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <iostream>
#include <memory>
#include <vector>

#include "cli/program.hpp"
#include "cli/terminal.hpp"
#include "nadir_candidates/commands.hpp"

int main(int argc, char** argv) {
  // Images of a quarter to half a megabyte come and go by the thousand. By default each is a mapping of its own, whose
  // pages the kernel clears again: a tenth of the work on a tile.
  mallopt(M_MMAP_THRESHOLD, 64 << 20);
  mallopt(M_TRIM_THRESHOLD, 128 << 20);
  nadir::install_signal_handlers();
  const nadir::SystemClock clock;
  std::vector<std::unique_ptr<nadir::Command>> commands;
  for (const auto make :
       {nadir::make_serve, nadir::make_work, nadir::make_status, nadir::make_export, nadir::make_installed,
        nadir::make_token_create, nadir::make_token_list, nadir::make_token_revoke}) {
    commands.push_back(make());
  }
  const nadir::ProgramText text{
      .name = "nadir-candidates",
      .summary = "stores tiles from flights and promotes those that independent flights agree on",
      .footer = "See docs/commands/ for a page per command."};
  winsize size{};
  const bool terminal = isatty(STDERR_FILENO) == 1;
  const bool sized = terminal && ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0;
  return nadir::run_program(text, commands, {argv + 1, argv + argc},
                            {std::cout, std::cerr, clock, nadir::progress_style(terminal), sized ? size.ws_col : 80});
}
