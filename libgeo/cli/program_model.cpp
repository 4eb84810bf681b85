#include "cli/program_model.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "base/files.hpp"
#include "cli/completions.hpp"
#include "cli/manual_page.hpp"
#include "cli/nadir_version.hpp"

namespace nadir {
namespace {

CommandModel describe(const std::string& program, Command& command) {
  CommandModel model{.words = std::string(command.name()),
                     .summary = std::string(command.summary()),
                     .details = std::string(command.details()),
                     .examples = std::string(command.examples()),
                     .options = {}};
  if (!command.group().empty()) model.words = fmt::format("{} {}", command.group(), model.words);
  Options options(model.words.empty() ? program : program + " " + model.words);
  CommonOptions common;
  declare(options, command, common);
  model.options = options.described();
  model.options.push_back(
      {.name = "--help", .placeholder = {}, .help = "show this help and exit", .shown_default = {}, .choices = {}});
  return model;
}

}  // namespace

std::vector<std::string> ProgramModel::first_words() const {
  std::vector<std::string> words;
  for (const CommandModel& command : commands) {
    const std::string word = command.words.substr(0, command.words.find(' '));
    if (std::find(words.begin(), words.end(), word) == words.end()) words.push_back(word);
  }
  return words;
}

void declare(Options& options, Command& command, CommonOptions& common) {
  command.setup(options);
  if (command.offers_json()) options.flag("--json", common.json, "print the result as JSON");
  options.flag("--quiet", common.quiet, "suppress progress and informational messages");
}

ProgramModel describe_program(const ProgramText& text, const std::vector<std::unique_ptr<Command>>& commands) {
  ProgramModel model{
      .name = text.name, .version = kVersion, .summary = text.summary, .footer = text.footer, .commands = {}};
  for (const auto& command : commands) model.commands.push_back(describe(text.name, *command));
  return model;
}

ProgramModel describe_single_command(const std::string& name, Command& command) {
  return {.name = name,
          .version = kVersion,
          .summary = std::string(command.summary()),
          .footer = {},
          .commands = {describe(name, command)},
          .section = 8};
}

void write_pages(const ProgramModel& program, const std::filesystem::path& folder) {
  const auto write = [&folder](const std::string& name, const std::string& text) {
    const std::filesystem::path path = folder / name;
    std::filesystem::create_directories(path.parent_path());
    write_file_atomic(path, text);
  };
  for (const auto& [name, text] : manual_pages(program)) write("man/" + name, text);
  write("completions/bash/" + program.name, bash_completion(program));
  write("completions/zsh/_" + program.name, zsh_completion(program));
  write(fmt::format("completions/fish/{}.fish", program.name), fish_completion(program));
}

}  // namespace nadir
