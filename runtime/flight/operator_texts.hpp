// What the operator must know, until there is an autopilot that hears it: before it is there, and while the link is
// lost, the latest texts wait, oldest first. There is no time in it: however long nobody hears, texts do not age. One
// thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <string>

#include "mavlink/messages.hpp"

namespace nadir {

class OperatorTexts {
 public:
  using Listener = std::function<void(TextSeverity severity, const std::string& text)>;

  explicit OperatorTexts(std::size_t most = 12) : most_(most) {}

  // No text: nothing to know. When too many wait, the oldest is dropped.
  void add(TextSeverity severity, std::string text);

  // All of them, to somebody who hears now.
  void tell(const Listener& listener);

  std::size_t waiting() const { return texts_.size(); }
  std::uint64_t dropped() const { return dropped_; }

 private:
  struct Text {
    TextSeverity severity;
    std::string text;
  };
  std::size_t most_;
  std::deque<Text> texts_;
  std::uint64_t dropped_ = 0;
};

}  // namespace nadir
