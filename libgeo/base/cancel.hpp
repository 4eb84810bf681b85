// A way to end long work early: whoever does it asks now and then, in its own thread, and leaves by an exception. So
// work that was given up has no result, and none can be taken for "nothing was found".
#pragma once

#include <functional>
#include <utility>

#include "base/error.hpp"

namespace nadir {

class Cancel {
 public:
  Cancel() = default;  // nobody ever wants it
  explicit Cancel(std::function<bool()> wanted) : wanted_(std::move(wanted)) {}

  // Throws Interrupted when it is wanted. Cheap enough for every step that takes a millisecond.
  void check() const {
    if (wanted_ && wanted_()) throw Interrupted();
  }

 private:
  std::function<bool()> wanted_;
};

}  // namespace nadir
