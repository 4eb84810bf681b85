#include "cli/help.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <ostream>

namespace nadir {
namespace {

constexpr std::size_t kColumns = 92;

// Breaks `text` between words; every line but the first starts with `indent` blanks. An empty line parts paragraphs, a
// single line end is a blank.
std::string wrapped(std::string_view text, std::size_t indent) {
  const std::string line_end = "\n" + std::string(indent, ' ');
  std::string result;
  std::size_t column = indent;
  std::size_t at = 0;
  while (at < text.size()) {
    if (text.substr(at).starts_with("\n\n")) {
      result += "\n" + line_end;
      column = indent;
      at += 2;
      continue;
    }
    if (text[at] == ' ' || text[at] == '\n') {
      ++at;
      continue;
    }
    const std::size_t end = std::min(text.find_first_of(" \n", at), text.size());
    const std::size_t length = end - at;
    if (column > indent && column + 1 + length > kColumns) {
      result += line_end;
      column = indent;
    } else if (column > indent) {
      result += ' ';
      ++column;
    }
    result += text.substr(at, length);
    column += length;
    at = end;
  }
  return result;
}

void print_entries(std::ostream& out, const std::vector<std::pair<std::string, std::string>>& entries) {
  std::size_t width = 0;
  for (const auto& [left, right] : entries) width = std::max(width, left.size());
  width = std::min<std::size_t>(width, 34);
  for (const auto& [left, right] : entries) {
    if (left.size() > width) {
      out << "  " << left << '\n' << std::string(width + 4, ' ');
    } else {
      out << "  " << left << std::string(width - left.size() + 2, ' ');
    }
    out << wrapped(right, width + 4) << '\n';
  }
}

void print_examples(std::ostream& out, std::string_view examples) {
  if (examples.empty()) return;
  out << "\nExamples:\n";
  while (!examples.empty()) {
    const std::size_t end = std::min(examples.find('\n'), examples.size());
    out << "  " << examples.substr(0, end) << '\n';
    examples.remove_prefix(std::min(end + 1, examples.size()));
  }
}

std::string entry_name(const Option::State& option) {
  std::string name = option.name;
  if (!option.positional() && option.takes_value) name += " " + option.placeholder;
  return option.many ? name + "..." : name;
}

std::string entry_help(const Option::State& option) {
  std::string help = option.help;
  if (!option.choices.empty()) help += fmt::format(" ({})", fmt::join(option.choices, ", "));
  if (!option.shown_default.empty()) help += fmt::format(" [{}]", option.shown_default);
  return help;
}

}  // namespace

void print_program_help(std::ostream& out, const ProgramText& text, const CommandList& commands) {
  out << text.name << ": " << text.summary << "\n\nUsage: " << text.name << " COMMAND [OPTIONS]\n";
  std::vector<std::pair<std::string, std::string>> entries;
  for (const auto& command : commands) {
    const std::string group(command->group());
    entries.emplace_back(group.empty() ? std::string(command->name()) : fmt::format("{} {}", group, command->name()),
                         std::string(command->summary()));
  }
  out << "\nCommands:\n";
  print_entries(out, entries);
  out << "\nFor every program:\n";
  print_entries(out,
                {{"COMMAND --help", "what a command does, its options, examples"}, {"--version", "print the version"}});
  if (!text.footer.empty()) out << '\n' << text.footer << '\n';
}

void print_group_help(std::ostream& out, const ProgramText& text, const CommandList& commands,
                      const std::string& group) {
  out << "Usage: " << text.name << ' ' << group << " VERB [OPTIONS]\n\nVerbs:\n";
  std::vector<std::pair<std::string, std::string>> entries;
  for (const auto& command : commands) {
    if (command->group() == group) entries.emplace_back(std::string(command->name()), std::string(command->summary()));
  }
  print_entries(out, entries);
}

void print_command_help(std::ostream& out, const std::string& full_name, const Command& command,
                        const Options::Impl& options) {
  std::string usage = full_name;
  std::vector<std::pair<std::string, std::string>> arguments, required, optional;
  for (const Option::State& option : options.options) {
    if (option.positional()) {
      usage += option.required ? " " + option.name : " [" + option.name + "]";
      arguments.emplace_back(entry_name(option), entry_help(option));
    } else if (option.required) {
      usage += " " + entry_name(option);
      required.emplace_back(entry_name(option), entry_help(option));
    } else {
      optional.emplace_back(entry_name(option), entry_help(option));
    }
  }
  optional.emplace_back("-h, --help", "this page");
  out << full_name << ": " << command.summary() << "\n\nUsage: " << wrapped(usage + " [OPTIONS]", 7) << '\n';
  if (!command.details().empty()) out << '\n' << wrapped(command.details(), 0) << '\n';
  const auto section = [&out](const char* title, const auto& entries) {
    if (entries.empty()) return;
    out << '\n' << title << ":\n";
    print_entries(out, entries);
  };
  section("Arguments", arguments);
  section("Required", required);
  section("Options", optional);
  print_examples(out, command.examples());
}

}  // namespace nadir
