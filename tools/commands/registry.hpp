// Every command of `nadir`, in the order in which `nadir --help` lists them.
#pragma once

#include <memory>
#include <vector>

#include "cli/command.hpp"
#include "cli/program.hpp"

namespace nadir {

ProgramText nadir_text();
std::vector<std::unique_ptr<Command>> all_commands();

}  // namespace nadir
