// A progress bar on a terminal, and the place where Ctrl-C reaches working code: advance() and begin() throw
// Interrupted in the thread that called begin(); other threads only count.
#pragma once

#include <chrono>
#include <iosfwd>
#include <mutex>
#include <string>
#include <thread>

#include "base/progress.hpp"

namespace nadir {

class TerminalProgress final : public Progress {
 public:
  // draw = false: no bar, only the look at Ctrl-C.
  TerminalProgress(std::ostream& err, bool draw, int columns);
  ~TerminalProgress() override;

  void begin(std::string_view label, std::uint64_t total, std::string_view unit) override;
  void advance(std::uint64_t steps) override;
  void end() override;

 private:
  void draw_line();

  std::ostream& err_;
  bool draw_;
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
