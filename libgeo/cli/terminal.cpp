#include "cli/terminal.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <csignal>
#include <nlohmann/json.hpp>
#include <ostream>

#include "base/error.hpp"

namespace nadir {
namespace {

// The one global of the program: a signal handler can reach nothing else.
std::atomic<bool> requested{false};
static_assert(std::atomic<bool>::is_always_lock_free);

extern "C" void on_signal(int) { requested.store(true); }

constexpr auto kRedrawEvery = std::chrono::milliseconds(100);
constexpr const char* kEraseLine = "\r\x1b[2K";

std::string clock_text(double seconds) {
  const auto whole = std::lround(seconds);
  return fmt::format("{}:{:02}", whole / 60, whole % 60);
}

}  // namespace

void install_signal_handlers() {
  struct sigaction action {};
  action.sa_handler = on_signal;
  // Without SA_RESTART: a read that waits (a medium that hangs, a pipe) ends, and the program with it.
  action.sa_flags = static_cast<int>(SA_RESETHAND);
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  struct sigaction ignore {};
  ignore.sa_handler = SIG_IGN;
  sigaction(SIGPIPE, &ignore, nullptr);
}

bool interrupt_requested() { return requested.load(); }
void request_interrupt(bool wanted) { requested.store(wanted); }

void throw_if_interrupted() {
  if (interrupt_requested()) throw Interrupted();
}

TerminalProgress::TerminalProgress(std::ostream& err, ProgressStyle style, int columns)
    : err_(err), style_(style), columns_(std::max(columns, 20)) {}

TerminalProgress::~TerminalProgress() { end(); }

void TerminalProgress::begin(std::string_view label, std::uint64_t total, std::string_view unit) {
  end();
  throw_if_interrupted();
  const std::lock_guard lock(mutex_);
  owner_ = std::this_thread::get_id();
  label_ = label;
  unit_ = unit;
  total_ = total;
  done_ = 0;
  running_ = true;
  started_ = std::chrono::steady_clock::now();
  drawn_ = started_;
  draw();
}

void TerminalProgress::advance(std::uint64_t steps) {
  {
    const std::lock_guard lock(mutex_);
    done_ += steps;
    const auto now = std::chrono::steady_clock::now();
    if (running_ && now - drawn_ >= kRedrawEvery) {
      drawn_ = now;
      draw();
    }
    if (std::this_thread::get_id() != owner_) return;
  }
  throw_if_interrupted();
}

void TerminalProgress::end() {
  const std::lock_guard lock(mutex_);
  if (running_ && style_ == ProgressStyle::bar) err_ << kEraseLine << std::flush;
  if (running_ && style_ == ProgressStyle::json_lines) write_json();
  running_ = false;
}

void TerminalProgress::draw() {
  if (style_ == ProgressStyle::bar) draw_bar();
  if (style_ == ProgressStyle::json_lines) write_json();
}

void TerminalProgress::write_json() {
  const nlohmann::json state = {{"label", label_}, {"done", done_}, {"total", total_}, {"unit", unit_}};
  err_ << nlohmann::json{{"progress", state}}.dump() + "\n" << std::flush;
}

void TerminalProgress::draw_bar() {
  const double elapsed_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - started_).count();
  const double share = total_ == 0 ? 0.0 : std::min(1.0, static_cast<double>(done_) / static_cast<double>(total_));
  std::string tail = total_ == 0 ? fmt::format(" {} {}", done_, unit_) : fmt::format(" {}/{} {}", done_, total_, unit_);
  const double rate = elapsed_s > 0 ? static_cast<double>(done_) / elapsed_s : 0;
  if (done_ > 0 && elapsed_s > 1) tail += fmt::format(", {:.{}f}/s", rate, rate < 10 ? 1 : 0);
  if (share > 0.02 && elapsed_s > 1) tail += fmt::format(", {} left", clock_text(elapsed_s * (1 - share) / share));
  const int room = columns_ - 1 - static_cast<int>(label_.size() + tail.size()) - 3;
  std::string bar;
  if (room >= 8 && total_ != 0) {
    const int width = std::min(room, 30);
    const int filled = static_cast<int>(share * width);
    bar = fmt::format(" [{}{}]", std::string(static_cast<std::size_t>(filled), '#'),
                      std::string(static_cast<std::size_t>(width - filled), ' '));
  }
  std::string line = label_ + bar + tail;
  if (line.size() >= static_cast<std::size_t>(columns_)) line.resize(static_cast<std::size_t>(columns_ - 1));
  err_ << kEraseLine << line << std::flush;
}

}  // namespace nadir
