#include "service/stop_signals.hpp"

#include <poll.h>
#include <sys/eventfd.h>
#include <sys/signalfd.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>

#include "base/error.hpp"

namespace nadir {

StopSignals::StopSignals() {
  sigemptyset(&signals_);
  sigaddset(&signals_, SIGINT);
  sigaddset(&signals_, SIGTERM);
  end_ = ::eventfd(0, EFD_CLOEXEC);
  if (end_ < 0) {
    throw Error({.what = "cannot listen for signals",
                 .found = system_error_text(errno),
                 .fix = "raise the limit of open files"});
  }
  ::pthread_sigmask(SIG_BLOCK, &signals_, &before_);
  listener_ = std::thread([this] { listen(); });
}

StopSignals::~StopSignals() {
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t written = ::write(end_, &one, sizeof one);
  listener_.join();
  ::close(end_);
  ::pthread_sigmask(SIG_SETMASK, &before_, nullptr);
}

void StopSignals::listen() {
  const int signals = ::signalfd(-1, &signals_, SFD_CLOEXEC);
  bool requested = false;  // by an earlier signal
  for (;;) {
    pollfd waits[] = {{signals, POLLIN, 0}, {end_, POLLIN, 0}};
    if (::poll(waits, 2, -1) < 0 && errno == EINTR) continue;
    if (waits[1].revents != 0) break;
    signalfd_siginfo info{};
    if (::read(signals, &info, sizeof info) != static_cast<ssize_t>(sizeof info)) continue;
    if (requested) ::_exit(128 + static_cast<int>(info.ssi_signo));
    requested = true;
    stop_.request_stop();
  }
  ::close(signals);
}

}  // namespace nadir
