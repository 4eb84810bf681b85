// Somebody who wants the work to end when it asks for the n-th time.
#pragma once

#include "base/progress.hpp"

namespace nadir::test {

class CancelAfter {
 public:
  static constexpr int kNever = -1;

  explicit CancelAfter(int asked) : until_(asked) {}
  Cancel cancel() {
    return Cancel([this] { return ++asked_ == until_; });
  }
  int asked() const { return asked_; }

 private:
  int until_, asked_ = 0;
};

}  // namespace nadir::test
