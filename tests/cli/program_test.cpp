// The program around the commands: which command runs, what is printed where, and the exit codes.
#include "cli/program.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <functional>
#include <new>
#include <sstream>
#include <system_error>

#include "base/error.hpp"
#include "cli/options.hpp"
#include "cli/terminal.hpp"

namespace nadir {
namespace {

class Probe final : public Command {
 public:
  explicit Probe(std::function<int(Context&)> work) : work_(std::move(work)) {}
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "build"; }
  std::string_view summary() const override { return "build a package"; }
  std::string_view examples() const override { return "nadir cache build --out x"; }
  bool offers_json() const override { return true; }
  void setup(Options& options) override { options.value("--out", out_, "PACKAGE", "where it goes").required(); }
  int run(Context& context) override { return work_(context); }

 private:
  std::string out_;
  std::function<int(Context&)> work_;
};

struct Outcome {
  int code;
  std::string out, err;
};

Outcome run(
    const std::vector<std::string>& args, std::function<int(Context&)> work = [](Context&) { return 0; }) {
  std::vector<std::unique_ptr<Command>> commands;
  commands.push_back(std::make_unique<Probe>(std::move(work)));
  std::ostringstream out, err;
  const FixedClock clock({0});
  const int code = run_program({"nadir", "a program", ""}, commands, args, {out, err, clock});
  return {code, out.str(), err.str()};
}

const std::vector<std::string> kGood{"cache", "build", "--out", "x"};

TEST(Program, PassesTheCommandsCodeOn) {
  EXPECT_EQ(run(kGood).code, 0);
  EXPECT_EQ(run(kGood, [](Context&) { return kRefused; }).code, 1);
  EXPECT_EQ(run(kGood).err, "");
}

TEST(Program, TurnsExceptionsIntoMessagesAndCodes) {
  const auto error = run(kGood, [](Context&) -> int { throw Error({.what = "no such file", .where = "x.tif"}); });
  EXPECT_EQ(error.code, 2);
  EXPECT_EQ(error.err, "nadir: no such file\n  where:    x.tif\n");
  EXPECT_EQ(error.out, "");
  EXPECT_EQ(run(kGood, [](Context&) -> int { throw Interrupted(); }).code, 130);
  EXPECT_EQ(run(kGood, [](Context&) -> int { throw std::bad_alloc(); }).code, 2);
  const auto fault = run(kGood, [](Context&) -> int { throw std::logic_error("oops"); });
  EXPECT_EQ(fault.code, 2);
  EXPECT_THAT(fault.err, ::testing::HasSubstr("please report"));
}

TEST(Program, AFullDiskBehindStandardOutputIsAnError) {
  const auto outcome = run(kGood, [](Context& context) {
    context.out.setstate(std::ios::badbit);
    return 0;
  });
  EXPECT_EQ(outcome.code, 2);
}

TEST(Program, SuggestsWhatWasMeant) {
  EXPECT_EQ(run({"cash"}).code, 2);
  EXPECT_THAT(run({"cahce"}).err, ::testing::HasSubstr("did you mean \"cache\""));
  EXPECT_THAT(run({"cache", "biuld"}).err, ::testing::HasSubstr("did you mean \"build\""));
  const auto option = run({"cache", "build", "--outt", "x"});
  EXPECT_EQ(option.code, 2);
  EXPECT_THAT(option.err, ::testing::HasSubstr("did you mean --out"));
  EXPECT_THAT(run({"cache", "build", "--zzzzzzz"}).err, ::testing::Not(::testing::HasSubstr("did you mean")));
}

TEST(Program, NamesWhatIsMissing) {
  EXPECT_EQ(run({}).code, 2);
  EXPECT_EQ(run({"cache"}).code, 2);
  EXPECT_THAT(run({"cache"}).err, ::testing::HasSubstr("build"));
  const auto outcome = run({"cache", "build"});
  EXPECT_EQ(outcome.code, 2);
  EXPECT_THAT(outcome.err, ::testing::HasSubstr("--out PACKAGE"));
}

TEST(Program, HelpGoesToStandardOutput) {
  for (const std::vector<std::string>& args :
       {std::vector<std::string>{"--help"}, {"-h"}, {"cache", "--help"}, {"cache", "build", "--help"}}) {
    const auto outcome = run(args);
    EXPECT_EQ(outcome.code, 0);
    EXPECT_EQ(outcome.err, "");
    EXPECT_THAT(outcome.out, ::testing::HasSubstr("build a package"));
  }
  EXPECT_THAT(run({"cache", "build", "--help"}).out, ::testing::HasSubstr("nadir cache build --out x"));
  EXPECT_THAT(run({"--version"}).out, ::testing::MatchesRegex("nadir [0-9]+\\.[0-9]+\\.[0-9]+\n"));
}

TEST(SingleCommand, SaysItsVersionAndHelpWhereverTheyStand) {
  const auto single = [](const std::vector<std::string>& args) {
    Probe probe([](Context&) { return 7; });
    std::ostringstream out, err;
    const FixedClock clock({0});
    const int code = run_single_command("nadird", probe, args, {out, err, clock});
    return Outcome{code, out.str(), err.str()};
  };
  EXPECT_EQ(single({"--out", "x"}).code, 7);
  for (const std::vector<std::string>& args : {std::vector<std::string>{"--version"}, {"--out", "x", "--version"}}) {
    EXPECT_EQ(single(args).code, 0);
    EXPECT_THAT(single(args).out, ::testing::MatchesRegex("nadird [0-9]+\\.[0-9]+\\.[0-9]+\n"));
  }
  EXPECT_THAT(single({"--out", "x", "--help"}).out, ::testing::HasSubstr("build a package"));
  EXPECT_EQ(single({}).code, 2);
}

TEST(Program, HelpWinsOverMissingOptions) { EXPECT_EQ(run({"cache", "build", "--out", "--help"}).code, 0); }

TEST(Program, JsonAndQuietReachTheCommand) {
  bool json = false, quiet = false;
  run({"cache", "build", "--json", "--quiet", "--out", "x"}, [&](Context& context) {
    json = context.json;
    quiet = context.quiet;
    return 0;
  });
  EXPECT_TRUE(json);
  EXPECT_TRUE(quiet);
}

TEST(Program, CtrlCReachesWorkThroughProgress) {
  const auto outcome = run(kGood, [](Context& context) {
    context.progress.begin("work", 3, "steps");
    context.progress.advance();
    request_interrupt(true);
    context.progress.advance();
    return 0;
  });
  request_interrupt(false);
  EXPECT_EQ(outcome.code, 130);
}

class Reader final : public Command {
 public:
  explicit Reader(std::function<int(Context&)> work) : work_(std::move(work)) {}
  std::string_view group() const override { return "cache"; }
  std::string_view name() const override { return "inspect"; }
  std::string_view summary() const override { return "read a package"; }
  std::string_view examples() const override { return "nadir cache inspect"; }
  bool offers_json() const override { return false; }
  void setup(Options&) override {}
  int run(Context& context) override { return work_(context); }

 private:
  std::function<int(Context&)> work_;
};

std::string message_of_reader(std::function<int(Context&)> work) {
  std::vector<std::unique_ptr<Command>> commands;
  commands.push_back(std::make_unique<Reader>(std::move(work)));
  std::ostringstream out, err;
  const FixedClock clock({0});
  run_program({"nadir", "a program", ""}, commands, {"cache", "inspect"}, {out, err, clock});
  return err.str();
}

TEST(Program, OnlyWritersReportThatNothingWasLeftBehind) {
  const auto interrupted = [](Context&) -> int { throw Interrupted(); };
  EXPECT_EQ(run(kGood, interrupted).err, "nadir: interrupted; no partial output was left behind\n");
  EXPECT_EQ(message_of_reader(interrupted), "nadir: interrupted\n");
}

// A path that is too long, or a folder that may not be read, is not a defect of the program.
TEST(Program, ErrorsNameWhatIsWrongWithAPath) {
  const auto outcome =
      run(kGood, [](Context&) -> int { return std::filesystem::exists(std::string(300, 'a')) ? 0 : 1; });
  EXPECT_EQ(outcome.code, 2);
  EXPECT_THAT(outcome.err, ::testing::HasSubstr("File name too long"));
  EXPECT_THAT(outcome.err, ::testing::HasSubstr("shorter path"));
  EXPECT_THAT(outcome.err, ::testing::Not(::testing::HasSubstr("defect")));
  EXPECT_LT(outcome.err.size(), 600U);
}

// No thread to be had, no memory: the machine's fault.
TEST(Program, WhatTheSystemRefusesIsNoDefect) {
  const auto thread =
      run(kGood, [](Context&) -> int { throw std::system_error(EAGAIN, std::generic_category(), "thread"); });
  EXPECT_EQ(thread.code, 2);
  EXPECT_THAT(thread.err, ::testing::HasSubstr("Resource temporarily unavailable"));
  EXPECT_THAT(thread.err, ::testing::HasSubstr("raise the limits"));
  const auto memory = run(kGood, [](Context&) -> int { throw std::bad_alloc(); });
  EXPECT_EQ(memory.code, 2);
  for (const auto& outcome : {thread, memory}) EXPECT_THAT(outcome.err, ::testing::Not(::testing::HasSubstr("defect")));
}

}  // namespace
}  // namespace nadir
