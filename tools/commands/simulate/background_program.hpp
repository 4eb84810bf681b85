// A program that runs beside this one until end(). What it says on standard error is kept, its last lines, for
// messages.
#pragma once

#include <atomic>
#include <condition_variable>
#include <deque>
#include <filesystem>
#include <mutex>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

namespace nadir {

class BackgroundProgram {
 public:
  // words: its path and its arguments. folder: where it runs.
  BackgroundProgram(std::vector<std::string> words, std::filesystem::path folder);
  ~BackgroundProgram() { end(); }
  BackgroundProgram(const BackgroundProgram&) = delete;
  BackgroundProgram& operator=(const BackgroundProgram&) = delete;

  void must_be_running() const;  // throws Error with what it said last
  // Until it has said a line with this text. Throws Error when it ends before or seconds pass, Interrupted on Ctrl-C.
  void wait_until_it_says(std::string_view text, double seconds);
  void end();                                            // in order (SIGTERM); waits for it
  const std::string& output() const { return output_; }  // standard output; after end()

 private:
  std::string name_;
  mutable std::mutex mutex_;
  std::deque<std::string> said_;
  std::string output_;
  std::atomic<bool> ended_ = false;
  std::jthread thread_;  // last: it uses everything above
};

}  // namespace nadir
