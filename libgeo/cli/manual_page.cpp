#include "cli/manual_page.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cstdint>

#include "cli/help_text.hpp"
#include "cli/program_model.hpp"

namespace nadir {
namespace {

// The code point at `at`, which moves behind it. Help texts are part of the program: they are valid UTF-8.
std::uint32_t next_code_point(std::string_view text, std::size_t& at) {
  const auto lead = static_cast<unsigned char>(text[at++]);
  if (lead < 0x80) return lead;
  const int following = lead >= 0xF0 ? 3 : lead >= 0xE0 ? 2 : 1;
  std::uint32_t code = lead & (0x3FU >> following);
  for (int i = 0; i < following && at < text.size(); ++i) {
    code = code << 6U | (static_cast<unsigned char>(text[at++]) & 0x3FU);
  }
  return code;
}

std::string upper(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char letter) { return static_cast<char>(std::toupper(letter)); });
  return text;
}

std::string preformatted(std::string_view text) {
  return fmt::format(".PP\n.nf\n.RS\n{}\n.RE\n.fi\n", roff_text(text));
}

std::string prose(std::string_view text) {
  std::string result;
  for (const std::string_view paragraph : split_text(text, "\n\n")) {
    result += laid_out(paragraph) ? preformatted(paragraph) : fmt::format(".PP\n{}\n", roff_text(paragraph));
  }
  return result;
}

std::string entry(const std::string& title, const std::string& explanation) {
  return fmt::format(".TP\n\\fB{}\\fR\n{}\n", title, roff_text(explanation));
}

// The option in bold, its value in italics.
std::string entry(const OptionDescription& option) {
  std::string title = roff_text(option.name);
  if (!option.positional && !option.placeholder.empty()) {
    title += fmt::format("\\fR \\fI{}", roff_text(option.placeholder));
  }
  if (option.many) title += "\\fR...";
  return entry(title, option.explanation());
}

std::string head(const ProgramModel& program, const std::string& page, std::string_view summary) {
  return fmt::format(
      ".\\\" Made from the help texts of {0}.\n"
      ".TH {1} {2} \"\" \"{0} {3}\" \"Nadir\"\n.nh\n.ad l\n.SH NAME\n{4} \\- {5}\n",
      program.name, roff_text(upper(page)), program.section, program.version, roff_text(page), roff_text(summary));
}

std::string command_page(const ProgramModel& program, const CommandModel& command, const std::string& page) {
  const std::string name = command.words.empty() ? program.name : program.name + " " + command.words;
  std::string text = head(program, page, command.summary);
  const std::string usage = usage_line(name, command.options).substr(name.size());
  text += fmt::format(".SH SYNOPSIS\n\\fB{}\\fR{}\n", roff_text(name), roff_text(usage));
  if (!command.details.empty()) text += ".SH DESCRIPTION\n" + prose(command.details);
  text += ".SH OPTIONS\n";
  for (const int rank : {0, 1, 2}) {  // as --help has them: arguments, required options, the others
    for (const OptionDescription& option : command.options) {
      if ((option.positional ? 0 : option.required ? 1 : 2) == rank) text += entry(option);
    }
  }
  if (program.has_one_job()) text += entry("\\-\\-version", "print the version and exit");
  if (!command.examples.empty()) {
    text += ".SH EXAMPLES\n";
    for (const std::string_view example : split_text(command.examples, "\n")) {
      text += fmt::format(".PP\n.RS\n{}\n.RE\n", roff_text(example));
    }
  }
  if (!program.has_one_job()) {
    text += fmt::format(".SH SEE ALSO\n.BR {} ({})\n", roff_text(program.name), program.section);
  }
  return text;
}

std::string program_page(const ProgramModel& program) {
  std::string text = head(program, program.name, program.summary);
  text += fmt::format(".SH SYNOPSIS\n\\fB{}\\fR COMMAND [OPTIONS]\n.SH COMMANDS\n", roff_text(program.name));
  for (const CommandModel& command : program.commands) text += entry(roff_text(command.words), command.summary);
  text += ".SH OPTIONS\n";
  text += entry("COMMAND \\-\\-help", "what a command does, its options, examples");
  text += entry("\\-\\-version", "print the version");
  if (!program.footer.empty()) text += ".SH NOTES\n" + prose(program.footer);
  text += ".SH SEE ALSO\n";
  for (const CommandModel& command : program.commands) {
    std::string page = program.name + "-" + command.words;
    std::replace(page.begin(), page.end(), ' ', '-');
    text += fmt::format(".BR {} ({}){}\n", roff_text(page), program.section,
                        &command == &program.commands.back() ? "" : ",");
  }
  return text;
}

}  // namespace

std::string roff_text(std::string_view text) {
  std::string result;
  bool line_begins = true;
  for (std::size_t at = 0; at < text.size();) {
    const std::uint32_t letter = next_code_point(text, at);
    if (line_begins && (letter == U'.' || letter == U'\'')) result += "\\&";
    line_begins = letter == U'\n';
    switch (letter) {
      case U'\\': result += "\\e"; break;
      case U'-': result += "\\-"; break;
      case U'\'': result += "\\(aq"; break;
      case U'`': result += "\\(ga"; break;
      case U'^': result += "\\(ha"; break;
      case U'~': result += "\\(ti"; break;
      default:
        if (letter < 0x80) {
          result += static_cast<char>(letter);
        } else {
          result += fmt::format("\\[u{:04X}]", letter);
        }
    }
  }
  return result;
}

std::vector<std::pair<std::string, std::string>> manual_pages(const ProgramModel& program) {
  std::vector<std::pair<std::string, std::string>> pages;
  const auto add = [&](const std::string& page, std::string text) {
    pages.emplace_back(fmt::format("{}.{}", page, program.section), std::move(text));
  };
  if (!program.has_one_job()) add(program.name, program_page(program));
  for (const CommandModel& command : program.commands) {
    std::string page = command.words.empty() ? program.name : program.name + "-" + command.words;
    std::replace(page.begin(), page.end(), ' ', '-');
    add(page, command_page(program, command, page));
  }
  return pages;
}

}  // namespace nadir
