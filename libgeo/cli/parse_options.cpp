// The only file that knows CLI11: it splits the arguments; what a wrong one means for the user is said here.
#include <fmt/format.h>

#include <CLI/CLI.hpp>

#include "base/error.hpp"
#include "cli/options_impl.hpp"

namespace nadir {
namespace {

using State = Option::State;

std::string help_hint(const std::string& command) { return fmt::format("`{} --help` lists the options", command); }

std::string shown(const State& option) {
  return option.positional() || !option.takes_value ? option.name : option.name + " " + option.placeholder;
}

void read_values(const State& option, const std::string& command) {
  for (const std::string& text : option.given) {
    if (!option.choices.empty() &&
        std::find(option.choices.begin(), option.choices.end(), text) == option.choices.end()) {
      throw UsageError({.what = fmt::format("{} does not know the value", option.name),
                        .expected = fmt::format("one of {}", fmt::join(option.choices, ", ")),
                        .found = fmt::format("\"{}\"", text),
                        .fix = help_hint(command)});
    }
    if (!option.read(text)) {
      throw UsageError({.what = fmt::format("{} has a value that cannot be read", option.name),
                        .expected = option.form,
                        .found = fmt::format("\"{}\"", text),
                        .fix = help_hint(command)});
    }
    for (const auto& [low, high] : option.ranges) {
      const double number = std::strtod(text.c_str(), nullptr);
      if (number >= low && number <= high) continue;
      throw UsageError({.what = fmt::format("{} is out of range", option.name),
                        .expected = fmt::format("{} to {}", low, high),
                        .found = text,
                        .fix = help_hint(command)});
    }
  }
}

[[noreturn]] void reject_extra(const Options::Impl& options, const std::string& command, const std::string& extra) {
  if (!extra.starts_with('-')) {
    throw UsageError({.what = fmt::format("{} does not take the argument", command),
                      .found = fmt::format("\"{}\"", extra),
                      .fix = help_hint(command)});
  }
  std::vector<std::string> known{"--help", "--quiet"};
  for (const State& option : options.options) {
    if (!option.positional()) known.push_back(option.name);
  }
  const std::string typed = extra.substr(0, extra.find('='));
  const std::string guess = nearest_word(typed, known);
  throw UsageError(
      {.what = fmt::format("{} has no option {}", command, typed),
       .fix = guess.empty() ? help_hint(command) : fmt::format("did you mean {}? {}", guess, help_hint(command))});
}

}  // namespace

ParseOutcome parse_options(Options::Impl& options, const std::string& command, const std::vector<std::string>& args) {
  CLI::App app;
  app.allow_extras();
  app.set_help_flag();
  ParseOutcome outcome;
  app.add_flag("-h,--help", outcome.help);
  for (State& option : options.options) {
    if (!option.takes_value) {
      app.add_flag_callback(option.name, [&option] { option.present = true; });
      continue;
    }
    const std::string name = option.positional() ? fmt::format("argument{}", option.name.size()) : option.name;
    // CLI11 allows no dots in names: positionals get a plain one.
    CLI::Option* parsed = app.add_option(name, [&option](const std::vector<std::string>& texts) {
      option.present = true;
      option.given = texts;
      return true;
    });
    parsed->expected(1, option.many ? CLI::detail::expected_max_vector_size : 1);
    parsed->allow_extra_args(option.many);
    parsed->multi_option_policy(option.many ? CLI::MultiOptionPolicy::TakeAll : CLI::MultiOptionPolicy::Throw);
  }
  try {
    app.parse(std::vector<std::string>(args.rbegin(), args.rend()));
  } catch (const CLI::ArgumentMismatch&) {
    if (outcome.help) return outcome;
    for (const State& option : options.options) {
      const auto times = std::count_if(args.begin(), args.end(), [&](const std::string& arg) {
        return arg == option.name || arg.starts_with(option.name + "=");
      });
      if (times > 1 && !option.many) {
        throw UsageError({.what = fmt::format("{} is given {} times", option.name, times), .expected = "once"});
      }
    }
    throw UsageError({.what = fmt::format("an option of {} has no value", command), .fix = help_hint(command)});
  } catch (const CLI::ParseError& error) {
    throw UsageError({.what = error.what(), .fix = help_hint(command)});
  }
  if (outcome.help) return outcome;
  if (const auto extras = app.remaining(); !extras.empty()) reject_extra(options, command, extras.front());

  for (const State& option : options.options) {
    if (option.required && !option.present) {
      throw UsageError({.what = fmt::format("{} needs {}", command, shown(option)),
                        .expected = option.help,
                        .fix = help_hint(command)});
    }
    if (!option.takes_value && option.present) option.read({});
    read_values(option, command);
  }
  for (const State& option : options.options) {
    for (const std::string& needed : option.needs) {
      const auto other = std::find_if(options.options.begin(), options.options.end(),
                                      [&](const State& candidate) { return candidate.name == needed; });
      if (option.present && (other == options.options.end() || !other->present)) {
        throw UsageError({.what = fmt::format("{} needs {} as well", option.name, needed), .fix = help_hint(command)});
      }
    }
  }
  return outcome;
}

}  // namespace nadir
