// Where the pictures of a live camera go: frame_folder.hpp, frame_stream.hpp.
#pragma once

#include <cstdint>

#include "base/bytes.hpp"

namespace nadir {

class FrameSink {
 public:
  virtual ~FrameSink() = default;

  // A whole JPEG, and when it was taken: UTC, microseconds since 1970. Throws Error when it cannot be taken.
  virtual void put(ByteView jpeg, std::int64_t unix_us) = 0;
};

}  // namespace nadir
