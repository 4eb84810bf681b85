// Pictures into a stream, as network cameras send them: multipart/x-mixed-replace with the boundary "nadir-frame". Each
// part's headers are Content-Type, Content-Length and X-Timestamp (UTC, seconds since 1970 with six decimals). ffmpeg
// reads it with `-f mpjpeg`; programs that look for JPEG marks alone find whole pictures as well.
#pragma once

#include <iosfwd>

#include "simulation/frame_sink.hpp"

namespace nadir {

class FrameStream final : public FrameSink {
 public:
  // Must outlive this.
  explicit FrameStream(std::ostream& out) : out_(out) {}

  void put(ByteView jpeg, std::int64_t unix_us) override;

 private:
  std::ostream& out_;
};

}  // namespace nadir
