#include <iostream>

#include "cli/program.hpp"
#include "cli/terminal.hpp"
#include "nadird_command.hpp"

int main(int argc, char** argv) {
  nadir::install_signal_handlers();
  const nadir::SystemClock clock;
  nadir::NadirdCommand command;
  return nadir::run_single_command("nadird", command, {argv + 1, argv + argc}, {std::cout, std::cerr, clock});
}
