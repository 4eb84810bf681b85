// What a command has of its terminal: Ctrl-C, as a flag that working code checks so that it can stop cleanly and leave
// no partial output behind, and a progress bar, which is where most code checks it.
#pragma once

#include <chrono>
#include <iosfwd>
#include <mutex>
#include <string>
#include <thread>

#include "base/progress.hpp"

namespace nadir {

// SIGINT and SIGTERM set the flag; a second one ends the process at once. SIGPIPE is ignored: a closed pipe shows as a
// failed stream.
void install_signal_handlers();

bool interrupt_requested();
void request_interrupt(bool wanted);  // for tests

void throw_if_interrupted();  // throws Interrupted

// How progress shows: not at all, as a bar on a terminal, or for another program, a line of JSON each time:
//   {"progress":{"label":"warping","done":12,"total":100,"unit":"tiles"}}
enum class ProgressStyle { none, bar, json_lines };

// begin() and advance() throw Interrupted after Ctrl-C in the thread that called begin(); other threads only count.
class TerminalProgress final : public Progress {
 public:
  TerminalProgress(std::ostream& err, ProgressStyle style, int columns);
  ~TerminalProgress() override;

  void begin(std::string_view label, std::uint64_t total, std::string_view unit) override;
  void advance(std::uint64_t steps) override;
  void end() override;

 private:
  void draw();
  void draw_bar();
  void write_json();

  std::ostream& err_;
  ProgressStyle style_;
  int columns_;
  std::mutex mutex_;
  std::thread::id owner_;
  std::string label_;
  std::string unit_;
  std::uint64_t total_ = 0;
  std::uint64_t done_ = 0;
  bool running_ = false;
  std::chrono::steady_clock::time_point started_{};
  std::chrono::steady_clock::time_point drawn_{};
};

}  // namespace nadir
