// Where the frames of a simulated live camera go: a watched folder, an MJPEG stream, each after the camera's delay.
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

  // A complete JPEG, and its capture time: UTC, microseconds since 1970. Throws Error when it cannot be written.
  virtual void put(ByteView jpeg, std::int64_t unix_us) = 0;
};

// Frames into a folder that another program watches: each appears atomically, under a name that holds its time and
// sorts by it, frame_<microseconds since 1970, UTC, 16 digits>.jpg. Until it is whole it has a hidden name that nobody
// can guess and that no link can have been planted under.
class FrameFolder final : public FrameSink {
 public:
  // Creates the folder when it is missing; existing files stay. keep: the maximum number of its own frames, the oldest
  // are removed first.
  explicit FrameFolder(std::filesystem::path folder, std::optional<int> keep = {});

  void put(ByteView jpeg, std::int64_t unix_us) override;

 private:
  std::filesystem::path folder_;
  std::optional<int> keep_;
  std::deque<std::filesystem::path> written_;
};

// Frames into a stream, as network cameras send them: multipart/x-mixed-replace with the boundary "nadir-frame". Each
// part's headers are Content-Type, Content-Length and X-Timestamp (UTC, seconds since 1970 with six decimals). ffmpeg
// reads it with `-f mpjpeg`; programs that scan for JPEG markers find complete frames as well.
class FrameStream final : public FrameSink {
 public:
  // Must outlive this.
  explicit FrameStream(std::ostream& out) : out_(out) {}

  void put(ByteView jpeg, std::int64_t unix_us) override;

 private:
  std::ostream& out_;
};

// A camera's delay: a thread delivers each frame at its due time, while the next ones are made. Several frames may be
// in flight at once, so that the delay does not limit the frame rate.
class DelayedSink {
 public:
  using Moment = std::chrono::steady_clock::time_point;

  explicit DelayedSink(FrameSink& sink);
  DelayedSink(const DelayedSink&) = delete;
  DelayedSink& operator=(const DelayedSink&) = delete;
  ~DelayedSink();  // drops the frames that still wait

  // Blocks only when the queue is full. Rethrows what the sink threw at an earlier frame.
  void put(Bytes jpeg, std::int64_t unix_us, Moment due);

  // Blocks until everything is delivered. Rethrows what the sink threw.
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
