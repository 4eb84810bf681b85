// Ends another thread's poll() early. An eventfd: any number of calls wake it once.
#pragma once

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <cstdint>

#include "base/error.hpp"

namespace nadir {

class WakeUp {
 public:
  WakeUp() : fd_(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) {
    if (fd_ < 0) throw Error({.what = "no event descriptor", .fix = "raise the limit of open files"});
  }
  ~WakeUp() { ::close(fd_); }
  WakeUp(const WakeUp&) = delete;
  WakeUp& operator=(const WakeUp&) = delete;

  void call() const {
    const std::uint64_t one = 1;
    [[maybe_unused]] const auto written = ::write(fd_, &one, sizeof one);  // full: it is awake already
  }

  // Until somebody calls, `descriptor` (-1: none) has one of these events, or the time is over.
  void wait(int descriptor, short events, int at_most_ms) const {
    pollfd waited[] = {{fd_, POLLIN, 0}, {descriptor, events, 0}};
    ::poll(waited, 2, at_most_ms);
    std::uint64_t calls = 0;
    [[maybe_unused]] const auto taken = ::read(fd_, &calls, sizeof calls);
  }

 private:
  int fd_;
};

}  // namespace nadir
