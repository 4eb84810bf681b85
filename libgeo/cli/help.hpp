// The help pages: of the program, of a group of commands, of one command.
#pragma once

#include <iosfwd>
#include <memory>
#include <string>
#include <vector>

#include "cli/options_impl.hpp"
#include "cli/program.hpp"

namespace nadir {

using CommandList = std::vector<std::unique_ptr<Command>>;

void print_program_help(std::ostream& out, const ProgramText& text, const CommandList& commands);
void print_group_help(std::ostream& out, const ProgramText& text, const CommandList& commands,
                      const std::string& group);
void print_command_help(std::ostream& out, const std::string& full_name, const Command& command,
                        const Options::Impl& options);

}  // namespace nadir
