// SIGINT and SIGTERM as a stop token for the service's threads. Create it in main before any other thread: later
// threads inherit the blocked signals. A second signal ends the process at once.
#pragma once

#include <csignal>
#include <stop_token>
#include <thread>

namespace nadir {

class StopSignals {
 public:
  StopSignals();
  ~StopSignals();
  StopSignals(const StopSignals&) = delete;
  StopSignals& operator=(const StopSignals&) = delete;

  std::stop_token token() const { return stop_.get_token(); }
  void request_stop() { stop_.request_stop(); }  // from inside, when a thread has failed

 private:
  void listen();

  std::stop_source stop_;
  sigset_t signals_{};
  sigset_t before_{};
  int end_ = -1;  // wakes the listener when this object ends
  std::thread listener_;
};

}  // namespace nadir
