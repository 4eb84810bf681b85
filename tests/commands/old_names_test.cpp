// Options that were renamed: for one release the old spelling means the same, and --help shows only the new one.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <sstream>

#include "base/error.hpp"
#include "cli/options.hpp"
#include "commands/commands.hpp"
#include "nadird_command.hpp"

namespace nadir {
namespace {

struct Renamed {
  const char *command, *old_name, *name, *value;
};

constexpr Renamed kRenamed[] = {
    {"cache build", "--gsd", "--gsd-m", "0.3"},
    {"cache build", "--ce90", "--ce90-m", "5"},
    {"cache update", "--gsd", "--gsd-m", "0.3"},
    {"cache update", "--ce90", "--ce90-m", "5"},
    {"cache index", "--gsd", "--gsd-m", "0.5"},
    {"cache index", "--overlap", "--overlap-percent", "40"},
    {"cache matchability", "--cruise-mps", "--speed-mps", "20"},
    {"cache verify", "--cruise-mps", "--speed-mps", "20"},
    {"mission import", "--half-width", "--half-width-m", "80"},
    {"mission import", "--agl", "--agl-m", "150"},
    {"mission import", "--height", "--ground-m", "12"},
    {"ortho", "--captured-at", "--captured", "2026-05-01T12:00:00Z"},
    {"provision autopilot", "--patience-s", "--timeout-s", "3"},
    {"provision boresight", "--most-frames", "--max-frames", "50"},
    {"provision camera", "--pictures", "--images", "board"},
    {"provision camera", "--min-pictures", "--min-images", "8"},
    {"simulate camera", "--seconds", "--duration-s", "3"},
    {"simulate camera", "--wait-s", "--timeout-s", "3"},
    {"simulate flight", "--frames", "--max-frames", "20"},
    {"sync push", "--patience", "--timeout-s", "60"},
    {"watch", "--interval", "--interval-s", "2"},
    {"nadird", "--token", "--token-file", "token"},
    {"nadird", "--keep-pictures", "--keep-frames", ""},
    {"nadird", "--anchor-every", "--anchor-every-m", "100"},
};

std::unique_ptr<Command> command_named(const std::string& words) {
  if (words == "nadird") return std::make_unique<NadirdCommand>();
  for (auto& command : all_commands()) {
    const std::string group(command->group());
    if ((group.empty() ? "" : group + " ") + std::string(command->name()) == words) return std::move(command);
  }
  return nullptr;
}

// The parser's error: none, or which option is missing; an unknown option is reported before anything else.
std::string parsed(const Renamed& renamed, std::vector<std::string> args) {
  const auto command = command_named(renamed.command);
  Options options(renamed.command);
  command->setup(options);
  try {
    options.parse(args);
  } catch (const UsageError& error) {
    return error.what();
  }
  return "";
}

TEST(OldNames, StillParseAsTheNewOnes) {
  for (const Renamed& renamed : kRenamed) {
    SCOPED_TRACE(std::string(renamed.command) + " " + renamed.old_name);
    ASSERT_NE(command_named(renamed.command), nullptr);
    const auto args = [&](const char* name) {
      std::vector<std::string> words{name};
      if (*renamed.value != '\0') words.emplace_back(renamed.value);
      return words;
    };
    EXPECT_EQ(parsed(renamed, args(renamed.old_name)), parsed(renamed, args(renamed.name)));
    EXPECT_THAT(parsed(renamed, args(renamed.name)), ::testing::Not(::testing::HasSubstr("has no option")));
    EXPECT_THAT(parsed(renamed, {"--no-such-option"}), ::testing::HasSubstr("has no option"));
  }
}

TEST(OldNames, AreNotInHelp) {
  for (const Renamed& renamed : kRenamed) {
    SCOPED_TRACE(std::string(renamed.command) + " " + renamed.old_name);
    const auto command = command_named(renamed.command);
    Options options(renamed.command);
    command->setup(options);
    std::ostringstream help;
    options.print_help(help, command->summary(), command->details(), command->examples());
    std::vector<std::string> words;
    std::istringstream text(help.str());
    for (std::string word; text >> word;) words.push_back(word);
    EXPECT_EQ(std::count(words.begin(), words.end(), renamed.old_name), 0);
    EXPECT_GE(std::count(words.begin(), words.end(), renamed.name), 1);
  }
}

}  // namespace
}  // namespace nadir
