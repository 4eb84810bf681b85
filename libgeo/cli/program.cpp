#include "cli/program.hpp"

#include <fmt/format.h>

#include <functional>
#include <ostream>

#include "base/error.hpp"
#include "cli/help.hpp"
#include "cli/interrupt.hpp"
#include "cli/terminal_progress.hpp"
#include "cli/nadir_version.hpp"

namespace nadir {
namespace {

struct Choice {
  Command* command = nullptr;  // none: help was printed
  std::string full_name;
  std::size_t words = 0;  // how many arguments the name took
};

bool asks_help(const std::string& word) { return word == "--help" || word == "-h" || word == "help"; }

[[noreturn]] void reject_word(const std::string& context, const std::string& kind, const std::string& typed,
                              const std::vector<std::string>& known) {
  const std::string guess = nearest_word(typed, known);
  const std::string hint = fmt::format("`{} --help` lists what there is", context);
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
                const Surroundings& surroundings) {
  Options::Impl declared;
  Options options(declared);
  bool json = false, quiet = false;
  command.setup(options);
  if (command.offers_json()) options.flag("--json", json, "print the result as JSON");
  options.flag("--quiet", quiet, "no progress and no talk, only results and errors");
  if (parse_options(declared, full_name, args).help) {
    print_command_help(surroundings.out, full_name, command, declared);
    return kAccepted;
  }
  TerminalProgress progress(surroundings.err, surroundings.err_is_terminal && !quiet, surroundings.err_columns);
  Context context{surroundings.out, surroundings.err, surroundings.clock, progress, json, quiet};
  return command.run(context);
}

// The one ladder from exceptions to messages and exit codes.
int guarded(const std::string& name, const Surroundings& surroundings, const std::function<int()>& work) {
  const auto say = [&](const std::string& message) {
    surroundings.err << name << ": " << message << '\n' << std::flush;
  };
  try {
    const int code = work();
    if (!surroundings.out.flush()) throw Error({.what = "the results could not be written to standard output"});
    return code;
  } catch (const Interrupted&) {
    say("interrupted; nothing was left behind");
    return kInterrupted;
  } catch (const Error& error) {
    say(error.what());
  } catch (const std::bad_alloc&) {
    say("out of memory");
  } catch (const std::exception& error) {
    say(fmt::format("unexpected: {}\n  to do:    this is a fault of the program; please report it with the command",
                    error.what()));
  }
  return kFailed;
}

}  // namespace

int run_program(const ProgramText& text, const CommandList& commands, const std::vector<std::string>& args,
                const Surroundings& surroundings) {
  return guarded(text.name, surroundings, [&] {
    const Choice choice = choose(text, commands, args, surroundings.out);
    if (choice.command == nullptr) return kAccepted;
    const std::vector<std::string> rest(args.begin() + static_cast<std::ptrdiff_t>(choice.words), args.end());
    return run_command(*choice.command, choice.full_name, rest, surroundings);
  });
}

int run_single_command(const std::string& name, Command& command, const std::vector<std::string>& args,
                       const Surroundings& surroundings) {
  return guarded(name, surroundings, [&] {
    if (args.size() == 1 && args[0] == "--version") {
      surroundings.out << name << ' ' << kVersion << '\n';
      return kAccepted;
    }
    return run_command(command, name, args, surroundings);
  });
}

}  // namespace nadir
