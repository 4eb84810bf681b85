// Progress that kills its process at a given word, as a power cut would. For programs that tests run.
#pragma once

#include <csignal>

#include "base/progress.hpp"

namespace nadir::test {

class DieAt final : public Progress {
 public:
  explicit DieAt(int event) : event_(event) {}  // 0: never
  void begin(std::string_view, std::uint64_t, std::string_view) override { count(); }
  void advance(std::uint64_t) override { count(); }
  void end() override { count(); }
  int seen() const { return seen_; }

 private:
  void count() {
    if (++seen_ == event_) ::raise(SIGKILL);
  }
  int event_;
  int seen_ = 0;
};

}  // namespace nadir::test
