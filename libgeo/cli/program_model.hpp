// What a program offers, as data: its commands with their options and texts, from the declarations that --help prints.
// Manual pages (manual_page.hpp) and completions (completions.hpp) are written from it, so that they cannot differ.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/program.hpp"

namespace nadir {

struct CommandModel {
  std::string words;  // "cache build"; empty for a program that has one job
  std::string summary, details, examples;
  std::vector<OptionDescription> options;  // with --json, --quiet and --help
};

struct ProgramModel {
  std::string name, version, summary, footer;
  std::vector<CommandModel> commands;
  int section = 1;  // of the manual: 8 for a service

  bool has_one_job() const { return commands.size() == 1 && commands.front().words.empty(); }
  // The first words of all commands, each once: groups, and commands without a group.
  std::vector<std::string> first_words() const;
};

// Options that each command has beside its own.
struct CommonOptions {
  bool json = false, quiet = false;
};

// Declares the options of `command`, and the common ones.
void declare(Options& options, Command& command, CommonOptions& common);

ProgramModel describe_program(const ProgramText& text, const std::vector<std::unique_ptr<Command>>& commands);
ProgramModel describe_single_command(const std::string& name, Command& command);

// Writes FOLDER/man/NAME.SECTION, one for the program and for each of its commands, and FOLDER/completions/bash/NAME,
// zsh/_NAME and fish/NAME.fish. For packages: --help does not show it (`nadir --write-pages FOLDER`).
void write_pages(const ProgramModel& program, const std::filesystem::path& folder);

}  // namespace nadir
