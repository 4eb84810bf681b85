#include "commands/simulate/background_program.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <chrono>
#include <utility>

#include "base/error.hpp"
#include "cli/terminal.hpp"
#include "planning/child_program.hpp"

namespace nadir {
namespace {

constexpr std::size_t kKeptLines = 40;
constexpr auto kLook = std::chrono::milliseconds(50);

}  // namespace

BackgroundProgram::BackgroundProgram(std::vector<std::string> words, std::filesystem::path folder)
    : name_(std::filesystem::path(words.front()).filename().string()) {
  thread_ = std::jthread(
      [this, call = ProgramCall{.words = std::move(words), .folder = std::move(folder)}](const std::stop_token& stop) {
        const auto keep = [this](std::string_view line) {
          const std::scoped_lock lock(mutex_);
          said_.emplace_back(line);
          if (said_.size() > kKeptLines) said_.pop_front();
        };
        try {
          const ProgramResult result = run_program_call(call, keep, [&stop] { return stop.stop_requested(); });
          output_ = result.out;
          keep(fmt::format("exit code {}", result.exit_code));
        } catch (const std::exception& error) {
          keep(error.what());
        }
        ended_ = true;
      });
}

void BackgroundProgram::must_be_running() const {
  if (!ended_) return;
  const std::scoped_lock lock(mutex_);
  throw Error({.what = name_ + " has ended", .found = fmt::format("{}", fmt::join(said_, "; "))});
}

void BackgroundProgram::wait_until_it_says(std::string_view text, double seconds) {
  const auto until = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  for (;;) {
    {
      const std::scoped_lock lock(mutex_);
      if (std::ranges::any_of(said_, [&](const std::string& line) { return line.find(text) != std::string::npos; }))
        return;
    }
    throw_if_interrupted();
    must_be_running();
    if (std::chrono::steady_clock::now() > until) {
      throw Error({.what = name_ + " did not begin",
                   .expected = fmt::format("\"{}\" within {:.0f} s", text, seconds),
                   .fix = "try again when the machine is less busy"});
    }
    std::this_thread::sleep_for(kLook);
  }
}

void BackgroundProgram::end() {
  thread_.request_stop();
  if (thread_.joinable()) thread_.join();
}

}  // namespace nadir
