#include "simulation/frame_stream.hpp"

#include <fmt/format.h>

#include <ostream>

#include "base/error.hpp"

namespace nadir {

void FrameStream::put(ByteView jpeg, std::int64_t unix_us) {
  out_ << fmt::format(
      "--nadir-frame\r\nContent-Type: image/jpeg\r\nContent-Length: {}\r\nX-Timestamp: {}.{:06}\r\n\r\n", jpeg.size(),
      unix_us / 1'000'000, unix_us % 1'000'000);
  out_.write(reinterpret_cast<const char*>(jpeg.data()), static_cast<std::streamsize>(jpeg.size()));
  out_ << "\r\n" << std::flush;
  if (!out_) {
    throw Error({.what = "the pictures cannot be written",
                 .where = "standard output",
                 .expected = "a program that reads them",
                 .found = "the pipe was closed"});
  }
}

}  // namespace nadir
