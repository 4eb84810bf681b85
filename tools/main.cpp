#include <sys/ioctl.h>
#include <unistd.h>

#include <iostream>

#include "cli/program.hpp"
#include "commands/commands.hpp"

int main(int argc, char** argv) {
  nadir::install_signal_handlers();
  const nadir::SystemClock clock;
  winsize size{};
  const bool terminal = isatty(STDERR_FILENO) == 1;
  const bool sized = terminal && ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0;
  const nadir::Environment surroundings{std::cout, std::cerr, clock, nadir::progress_style(terminal),
                                        sized ? size.ws_col : 80};
  return nadir::run_program(nadir::nadir_text(), nadir::all_commands(), {argv + 1, argv + argc}, surroundings);
}
