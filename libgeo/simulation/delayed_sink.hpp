// A camera's delay: each picture is handed on at its own moment, on a thread of its own, while the next ones are made.
// A camera that is asked for more pictures than fit one after the other into its delay still delivers them all.
#pragma once

#include <chrono>
#include <condition_variable>
#include <deque>
#include <exception>
#include <mutex>
#include <thread>

#include "simulation/frame_sink.hpp"

namespace nadir {

class DelayedSink {
 public:
  using Moment = std::chrono::steady_clock::time_point;

  explicit DelayedSink(FrameSink& sink);
  DelayedSink(const DelayedSink&) = delete;
  DelayedSink& operator=(const DelayedSink&) = delete;
  ~DelayedSink();  // what still waits is dropped

  // Waits only when very many wait already. Throws what the sink threw at an earlier picture.
  void put(Bytes jpeg, std::int64_t unix_us, Moment due);

  // Until everything is handed on. Throws what the sink threw.
  void finish();

  int handed_on() const;

 private:
  struct Picture {
    Bytes jpeg;
    std::int64_t unix_us = 0;
    Moment due;
  };

  void run(const std::stop_token& stop);
  void throw_if_failed() const;

  FrameSink& sink_;
  mutable std::mutex mutex_;
  std::condition_variable_any changed_;
  std::deque<Picture> waiting_;  // the first stays until the sink has it
  std::exception_ptr failed_;
  int handed_on_ = 0;
  std::jthread thread_;  // last: it uses everything above
};

}  // namespace nadir
