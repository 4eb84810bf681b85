// How long work tells how far it is. Algorithms report; only tools/ draws bars, and on a terminal alone.
#pragma once

#include <cstdint>
#include <string_view>

namespace nadir {

class Progress {
 public:
  virtual ~Progress() = default;
  // total: how many steps there will be. `unit` is plural: "tiles", "frames".
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

}  // namespace nadir
