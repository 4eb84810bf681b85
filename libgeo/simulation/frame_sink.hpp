// Where the pictures of a live camera go: frame_folder.hpp, frame_stream.hpp.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <exception>
#include <filesystem>
#include <iosfwd>
#include <mutex>
#include <optional>
#include <thread>

#include "base/bytes.hpp"

namespace nadir {

class FrameSink {
 public:
  virtual ~FrameSink() = default;

  // A whole JPEG, and when it was taken: UTC, microseconds since 1970. Throws Error when it cannot be taken.
  virtual void put(ByteView jpeg, std::int64_t unix_us) = 0;
};

// Pictures into a folder that somebody watches: each appears whole, under a name that carries its time and sorts by it,
// frame_<microseconds since 1970, UTC, 16 digits>.jpg.

class FrameFolder final : public FrameSink {
 public:
  // Makes the folder when it is missing; what lies in it stays. keep: so many of its own pictures at most, the oldest
  // go first.
  explicit FrameFolder(std::filesystem::path folder, std::optional<int> keep = {});

  void put(ByteView jpeg, std::int64_t unix_us) override;

 private:
  std::filesystem::path folder_;
  std::optional<int> keep_;
  std::deque<std::filesystem::path> written_;
};

// Pictures into a stream, as network cameras send them: multipart/x-mixed-replace with the boundary "nadir-frame". Each
// part's headers are Content-Type, Content-Length and X-Timestamp (UTC, seconds since 1970 with six decimals). ffmpeg
// reads it with `-f mpjpeg`; programs that look for JPEG marks alone find whole pictures as well.

class FrameStream final : public FrameSink {
 public:
  // Must outlive this.
  explicit FrameStream(std::ostream& out) : out_(out) {}

  void put(ByteView jpeg, std::int64_t unix_us) override;

 private:
  std::ostream& out_;
};

// A camera's delay: each picture is handed on at its own moment, on a thread of its own, while the next ones are made.
// A camera that is asked for more pictures than fit one after the other into its delay still delivers them all.

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

  int delivered() const;

 private:
  struct QueuedFrame {
    Bytes jpeg;
    std::int64_t unix_us = 0;
    Moment due;
  };

  void run(const std::stop_token& stop);
  void throw_if_failed() const;

  FrameSink& sink_;
  mutable std::mutex mutex_;
  std::condition_variable_any changed_;
  std::deque<QueuedFrame> waiting_;  // the first stays until the sink has it
  std::exception_ptr failed_;
  int delivered_ = 0;
  std::jthread thread_;  // last: it uses everything above
};

}  // namespace nadir
