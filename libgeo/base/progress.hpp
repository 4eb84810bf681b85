// Long work: progress and cancellation. Algorithms report their progress; only tools/ draws bars, and only on
// a terminal.
#pragma once

#include <cstdint>
#include <functional>
#include <string_view>
#include <utility>

#include "base/error.hpp"

namespace nadir {

class Progress {
 public:
  virtual ~Progress() = default;
  // total: number of steps. `unit` is plural: "tiles", "frames".
  virtual void begin(std::string_view label, std::uint64_t total, std::string_view unit) = 0;
  virtual void advance(std::uint64_t steps = 1) = 0;
  virtual void end() = 0;
};

class NoProgress final : public Progress {
 public:
  void begin(std::string_view, std::uint64_t, std::string_view) override {}
  void advance(std::uint64_t) override {}
  void end() override {}
};

// Cancellation by polling: the worker calls check() now and then in its own thread and leaves by an exception, so
// cancelled work has no result that could be mistaken for "nothing found".
class Cancel {
 public:
  Cancel() = default;  // never cancelled
  explicit Cancel(std::function<bool()> requested) : requested_(std::move(requested)) {}

  // Throws Interrupted when cancellation was requested. Cheap enough for every step that takes a millisecond.
  void check() const {
    if (requested_ && requested_()) throw Interrupted();
  }

 private:
  std::function<bool()> requested_;
};

}  // namespace nadir
