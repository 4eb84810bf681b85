#include "cli/program.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <ostream>
#include <system_error>

#include "base/error.hpp"
#include "base/printable.hpp"
#include "cli/nadir_version.hpp"
#include "cli/options.hpp"
#include "cli/program_model.hpp"

namespace nadir {
namespace {

using CommandList = std::vector<std::unique_ptr<Command>>;

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
  out << "\nOptions:\n";
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

struct Choice {
  Command* command = nullptr;  // none: help was printed
  std::string full_name;
  std::size_t words = 0;  // how many arguments the name took
};

bool asks_help(const std::string& word) { return word == "--help" || word == "-h" || word == "help"; }

[[noreturn]] void reject_word(const std::string& context, const std::string& kind, const std::string& typed,
                              const std::vector<std::string>& known) {
  const std::string guess = nearest_word(typed, known);
  const std::string hint = fmt::format("`{} --help` lists the {}s", context, kind);
  throw UsageError({.what = fmt::format("{} has no {} \"{}\"", context, kind, typed),
                    .fix = guess.empty() ? hint : fmt::format("did you mean \"{}\"? {}", guess, hint)});
}

Choice choose(const ProgramText& text, const CommandList& commands, const std::vector<std::string>& args,
              std::ostream& out) {
  if (args.empty()) {
    throw UsageError({.what = fmt::format("{} needs a command", text.name),
                      .fix = fmt::format("`{} --help` lists the commands", text.name)});
  }
  if (asks_help(args[0])) {
    print_program_help(out, text, commands);
    return {};
  }
  if (args[0] == "--version") {
    out << text.name << ' ' << kVersion << '\n';
    return {};
  }
  std::vector<std::string> words, verbs;
  for (const auto& command : commands) {
    if (command->group().empty() && command->name() == args[0]) return {command.get(), text.name + " " + args[0], 1};
    words.emplace_back(command->group().empty() ? command->name() : command->group());
    if (command->group() != args[0]) continue;
    verbs.emplace_back(command->name());
    if (args.size() > 1 && command->name() == args[1]) {
      return {command.get(), fmt::format("{} {} {}", text.name, args[0], args[1]), 2};
    }
  }
  if (verbs.empty()) reject_word(text.name, "command", args[0], words);
  const std::string group = text.name + " " + args[0];
  if (args.size() == 1) {
    throw UsageError({.what = group + " needs a verb",
                      .expected = fmt::format("one of {}", fmt::join(verbs, ", ")),
                      .fix = fmt::format("`{} --help` lists the verbs", group)});
  }
  if (asks_help(args[1])) {
    print_group_help(out, text, commands, args[0]);
    return {};
  }
  reject_word(group, "verb", args[1], verbs);
}

int run_command(Command& command, const std::string& full_name, const std::vector<std::string>& args,
                const Environment& environment) {
  Options options(full_name);
  CommonOptions common;
  declare(options, command, common);
  if (!options.parse(args)) {
    options.print_help(environment.out, command.summary(), command.details(), command.examples());
    return kAccepted;
  }
  const bool bar_unwanted = common.quiet && environment.progress == ProgressStyle::bar;
  TerminalProgress progress(environment.err, bar_unwanted ? ProgressStyle::none : environment.progress,
                            environment.err_columns);
  Context context{environment.out, environment.err, environment.clock, progress, common.json, common.quiet};
  return command.run(context);
}

// Manual pages and completions for packages; --help does not show it.
bool asks_pages(const std::vector<std::string>& args) { return args.size() == 2 && args[0] == "--write-pages"; }

bool names_output(const std::vector<std::string>& args) {
  return std::any_of(args.begin(), args.end(),
                     [](const std::string& word) { return word == "--out" || word.starts_with("--out="); });
}

// std::filesystem reports by exceptions of its own what is wrong with a path of the user's.
std::string text_of(const std::filesystem::filesystem_error& error) {
  const std::error_code code = error.code();
  std::string fix = "check the path";
  if (code == std::errc::permission_denied) fix = "check the permissions of the file and of its folders";
  if (code == std::errc::filename_too_long) {
    fix = "move it to a shorter path: a name may have 255 bytes, a path 4095";
  }
  if (code == std::errc::no_space_on_device) fix = "free space on this disk, or write elsewhere";
  std::string where = error.path1().string();
  constexpr std::size_t kShown_bytes = 200;
  if (where.size() > kShown_bytes) where = where.substr(0, kShown_bytes) + "...";
  return Error({.what = "cannot use a file or folder", .where = where, .found = code.message(), .fix = fix}).what();
}

// The one ladder from exceptions to messages and exit codes.
int guarded(const std::string& name, const Environment& environment, const std::vector<std::string>& args,
            const std::function<int()>& work) {
  const auto say = [&](const std::string& message) {
    environment.err << name << ": " << printable_lines(message) << '\n' << std::flush;
  };
  try {
    const int code = work();
    if (!environment.out.flush()) {
      throw Error({.what = "cannot write the results",
                   .where = "standard output",
                   .found = "a full disk, or a pipe that nobody reads",
                   .fix = "free space where it leads to, and run the command again"});
    }
    return code;
  } catch (const Interrupted&) {
    say(names_output(args) ? "interrupted; no partial output was left behind" : "interrupted");
    return kInterrupted;
  } catch (const Error& error) {
    say(error.what());
  } catch (const std::filesystem::filesystem_error& error) {
    say(text_of(error));
  } catch (const std::system_error& error) {  // of a thread that cannot be started, above all
    say(Error({.what = "the system refuses what the program needs",
               .found = error.code().message(),
               .fix = "stop other programs, or raise the limits of processes and open files"})
            .what());
  } catch (const std::bad_alloc&) {
    say("out of memory\n  to do:    stop other programs, or give less to do at once");
  } catch (const std::exception& error) {
    say(
        fmt::format("unexpected error: {}\n  to do:    this is a defect in the program; please report it together with "
                    "the command line",
                    error.what()));
  }
  return kFailed;
}

}  // namespace

ProgressStyle progress_style(bool err_is_terminal) {
  const char* const wanted = std::getenv("NADIR_PROGRESS");  // NOLINT(concurrency-mt-unsafe): before any thread
  if (wanted != nullptr && std::string_view(wanted) == "json") return ProgressStyle::json_lines;
  return err_is_terminal ? ProgressStyle::bar : ProgressStyle::none;
}

int run_program(const ProgramText& text, const CommandList& commands, const std::vector<std::string>& args,
                const Environment& environment) {
  return guarded(text.name, environment, args, [&] {
    if (asks_pages(args)) {
      write_pages(describe_program(text, commands), args[1]);
      return kAccepted;
    }
    const Choice choice = choose(text, commands, args, environment.out);
    if (choice.command == nullptr) return kAccepted;
    const std::vector<std::string> rest(args.begin() + static_cast<std::ptrdiff_t>(choice.words), args.end());
    return run_command(*choice.command, choice.full_name, rest, environment);
  });
}

int run_single_command(const std::string& name, Command& command, const std::vector<std::string>& args,
                       const Environment& environment) {
  return guarded(name, environment, args, [&] {
    // Wherever it stands, as --help: a container's entry point has options of its own before it.
    if (std::ranges::find(args, "--version") != args.end()) {
      environment.out << name << ' ' << kVersion << '\n';
      return kAccepted;
    }
    if (asks_pages(args)) {
      write_pages(describe_single_command(name, command), args[1]);
      return kAccepted;
    }
    return run_command(command, name, args, environment);
  });
}

}  // namespace nadir
