#include "cli/completions.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <string_view>

#include "cli/program_model.hpp"

namespace nadir {
namespace {

// Of "cache build": "cache" and "build". A command without a group has no verb.
std::string first_of(const CommandModel& command) { return command.words.substr(0, command.words.find(' ')); }
std::string verb_of(const CommandModel& command) {
  const std::size_t blank = command.words.find(' ');
  return blank == std::string::npos ? std::string() : command.words.substr(blank + 1);
}

std::vector<std::string> verbs_of(const ProgramModel& program, const std::string& group) {
  std::vector<std::string> verbs;
  for (const CommandModel& command : program.commands) {
    if (first_of(command) == group && !verb_of(command).empty()) verbs.push_back(verb_of(command));
  }
  return verbs;
}

// What a first word does: a command's own summary, or the verbs of a group.
std::string about(const ProgramModel& program, const std::string& word) {
  for (const CommandModel& command : program.commands) {
    if (command.words == word) return command.summary;
  }
  return fmt::format("{}", fmt::join(verbs_of(program, word), ", "));
}

// A function's name: "_nadir_cache_build".
std::string identifier(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](char letter) { return letter == ' ' || letter == '-'; }, '_');
  return "_" + text;
}

// In single quotes, for every shell here; `escape` names what needs a backslash within them.
std::string single_quoted(std::string_view text, std::string_view escape = {}, std::string_view apostrophe = "'\\''") {
  std::string result = "'";
  for (const char letter : text) {
    if (letter == '\'') {
      result += apostrophe;
      continue;
    }
    if (escape.find(letter) != std::string_view::npos) result += '\\';
    result += letter;
  }
  return result + "'";
}

// Values that are not completed (numbers, times) are still taken: the option before them is not repeated.
std::string bash_values(const CommandModel& command) {
  std::string cases;
  std::vector<std::string> files, nothing;
  for (const OptionDescription& option : command.options) {
    if (option.positional || option.placeholder.empty()) continue;
    if (!option.choices.empty()) {
      cases += fmt::format("        {}) words={} ;;\n", option.name,
                           single_quoted(fmt::format("{}", fmt::join(option.choices, " "))));
    } else {
      (option.free_text ? files : nothing).push_back(option.name);
    }
  }
  if (!files.empty()) cases += fmt::format("        {}) files=yes ;;\n", fmt::join(files, "|"));
  if (!nothing.empty()) cases += fmt::format("        {}) ;;\n", fmt::join(nothing, "|"));
  return cases;
}

std::string bash_command(const CommandModel& command) {
  std::vector<std::string> names;
  bool positional = false;
  for (const OptionDescription& option : command.options) {
    if (option.positional) {
      positional = true;
    } else {
      names.push_back(option.name);
    }
  }
  return fmt::format("      case $before in\n{}        *) words={}{} ;;\n      esac\n", bash_values(command),
                     single_quoted(fmt::format("{}", fmt::join(names, " "))),
                     positional ? "; [[ $word == -* ]] || { words=''; files=yes; }" : "");
}

std::string zsh_option(const OptionDescription& option) {
  constexpr std::string_view kSpecial = "[]:\\";
  const std::string action = !option.choices.empty() ? fmt::format("({})", fmt::join(option.choices, " "))
                             : option.free_text      ? "_files"
                                                     : " ";
  const auto escaped = [&](const std::string& text) {
    std::string inner = single_quoted(text, kSpecial);
    return inner.substr(1, inner.size() - 2);
  };
  if (option.positional) {
    return fmt::format("'{}:{}:{}'", option.required ? "" : ":", escaped(option.name), action);
  }
  const std::string help = fmt::format("[{}]", escaped(option.explanation()));
  if (option.placeholder.empty()) return fmt::format("'{}{}'", option.name, help);
  return fmt::format("'{}{}{}:{}:{}'", option.many ? "*" : "", option.name, help, escaped(option.placeholder), action);
}

std::string zsh_arguments(const CommandModel& command, const std::string& indent) {
  std::string text = indent + "_arguments";
  for (const OptionDescription& option : command.options)
    text += fmt::format(" \\\n{}  {}", indent, zsh_option(option));
  return text + "\n";
}

std::string fish_option(const std::string& start, const OptionDescription& option) {
  // fish knows two escapes within single quotes: \' and \\.
  const auto fish_quoted = [](const std::string& text) { return single_quoted(text, "\\", "\\'"); };
  std::string line = start + " -l " + option.name.substr(2);
  if (!option.placeholder.empty()) {
    if (!option.choices.empty()) {
      line += fmt::format(" -x -a {}", fish_quoted(fmt::format("{}", fmt::join(option.choices, " "))));
    } else {
      line += option.free_text ? " -r -F" : " -x";
    }
  }
  return fmt::format("{} -d {}\n", line, fish_quoted(option.explanation()));
}

}  // namespace

std::string bash_completion(const ProgramModel& program) {
  const std::string function = identifier(program.name);
  std::string text = fmt::format(
      "# bash completion of {0}, made from its help texts.\n"
      "{1}() {{\n"
      "  local word=${{COMP_WORDS[COMP_CWORD]}} before=${{COMP_WORDS[COMP_CWORD - 1]}} words='' files=''\n",
      program.name, function);
  if (program.has_one_job()) {
    text += bash_command(program.commands.front());
  } else {
    text += "  case $COMP_CWORD:${COMP_WORDS[1]}:${COMP_WORDS[2]-} in\n";
    text += fmt::format("    1:*) words='{} --help --version' ;;\n", fmt::join(program.first_words(), " "));
    for (const std::string& word : program.first_words()) {
      const std::vector<std::string> verbs = verbs_of(program, word);
      if (!verbs.empty()) text += fmt::format("    2:{}:*) words='{} --help' ;;\n", word, fmt::join(verbs, " "));
    }
    for (const CommandModel& command : program.commands) {
      const std::string verb = verb_of(command);
      text += fmt::format("    *:{}:{})\n{}      ;;\n", first_of(command), verb.empty() ? "*" : verb,
                          bash_command(command));
    }
    text += "  esac\n";
  }
  text += fmt::format(
      "  mapfile -t COMPREPLY < <(compgen -W \"$words\" -- \"$word\")\n"
      "  [[ -z $files ]] || compopt -o default 2>/dev/null\n"
      "}}\n"
      "complete -F {} {}\n",
      function, program.name);
  return text;
}

std::string zsh_completion(const ProgramModel& program) {
  std::string text = fmt::format("#compdef {0}\n# zsh completion of {0}, made from its help texts.\n", program.name);
  const std::string function = identifier(program.name);
  if (program.has_one_job()) {
    return text + fmt::format("{0}() {{\n{1}}}\n{0} \"$@\"\n", function, zsh_arguments(program.commands.front(), "  "));
  }
  text += function + "() {\n  local -a known\n  if (( CURRENT == 2 )); then\n    known=(\n";
  for (const std::string& word : program.first_words()) {
    text += fmt::format("      {}\n", single_quoted(word + ":" + about(program, word)));
  }
  text += "    )\n    _describe -t commands command known\n    return\n  fi\n  case ${words[2]} in\n";
  for (const std::string& word : program.first_words()) {
    text += fmt::format("    {})\n", word);
    const bool is_group = !verbs_of(program, word).empty();
    if (is_group) {
      text += "      if (( CURRENT == 3 )); then\n        known=(\n";
      for (const CommandModel& command : program.commands) {
        if (first_of(command) == word)
          text += fmt::format("          {}\n", single_quoted(verb_of(command) + ":" + command.summary));
      }
      text += "        )\n        _describe -t commands verb known\n        return\n      fi\n";
    }
    // _arguments takes the words behind the command's own.
    text += is_group ? "      case ${words[3]} in\n" : "";
    for (const CommandModel& command : program.commands) {
      if (first_of(command) != word) continue;
      if (is_group) {
        text += fmt::format(
            "        {})\n          words=(\"${{words[3]}}\" \"${{(@)words[4,-1]}}\")\n          (( CURRENT -= 2 "
            "))\n{}          ;;\n",
            verb_of(command), zsh_arguments(command, "          "));
      } else {
        text += fmt::format("      words=(\"${{(@)words[2,-1]}}\")\n      (( CURRENT -= 1 ))\n{}",
                            zsh_arguments(command, "      "));
      }
    }
    text += is_group ? "      esac\n      ;;\n" : "      ;;\n";
  }
  return text + fmt::format("  esac\n}}\n{} \"$@\"\n", function);
}

std::string fish_completion(const ProgramModel& program) {
  const auto fish_quoted = [](const std::string& text) { return single_quoted(text, "\\", "\\'"); };
  std::string text = fmt::format("# fish completion of {}, made from its help texts.\n", program.name);
  const std::string start = "complete -c " + program.name;
  if (program.has_one_job()) {
    text += start + " -f\n";
    for (const OptionDescription& option : program.commands.front().options) {
      if (!option.positional) text += fish_option(start, option);
    }
    return text;
  }
  // How many words stand before the one that is completed, and which.
  const std::string at = identifier(program.name) + "_at";
  text += fmt::format(
      "function {0}\n"
      "    set -l words (commandline -opc)\n"
      "    set -l last (math 1 + (count $argv))\n"
      "    test (count $words) -ge $last; and test \"$words[2..$last]\" = \"$argv\"\n"
      "end\n"
      "function {0}_end_of\n"
      "    test (count (commandline -opc)) -eq (math 1 + (count $argv)); or return 1\n"
      "    test (count $argv) -eq 0; or {0} $argv\n"
      "end\n",
      at);
  text += start + " -f\n";
  for (const std::string& word : program.first_words()) {
    text += fmt::format("{} -n {}_end_of -a {} -d {}\n", start, at, word, fish_quoted(about(program, word)));
  }
  for (const CommandModel& command : program.commands) {
    const std::string verb = verb_of(command), first = first_of(command);
    if (!verb.empty()) {
      text += fmt::format("{} -n '{}_end_of {}' -a {} -d {}\n", start, at, first, verb, fish_quoted(command.summary));
    }
    const std::string here = fmt::format("{} -n '{} {}'", start, at, command.words);
    const bool files = std::any_of(command.options.begin(), command.options.end(), [](const OptionDescription& option) {
      return option.positional && option.free_text;
    });
    if (files) text += here + " -F\n";
    for (const OptionDescription& option : command.options) {
      if (!option.positional) text += fish_option(here, option);
    }
  }
  return text;
}

}  // namespace nadir
