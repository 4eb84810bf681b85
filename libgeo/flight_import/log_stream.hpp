// Sequential reading of a log: a window that moves over a file or over memory, and numbers out of bytes.
//
// Logs come from anywhere. Their readers never allocate by a length that a file states: a record is looked at through
// peek(), which returns what is really there, and records of all formats are smaller than the window.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <string>

#include "base/bytes.hpp"
#include "base/input_file.hpp"

namespace nadir {

class LogStream {
 public:
  static constexpr std::size_t kMaxPeek = std::size_t{1} << 17;  // bytes; more than any record

  explicit LogStream(InputFile file);
  LogStream(ByteView bytes, std::string name);  // outlive this

  const std::string& name() const { return name_; }  // for messages
  std::uint64_t size() const { return size_; }
  std::uint64_t position() const { return position_; }
  bool at_end() const { return position_ >= size_; }

  // The next `count` bytes, fewer at the end of the log. Valid until the next call.
  ByteView peek(std::size_t count);
  void skip(std::uint64_t count);
  void seek(std::uint64_t position);

 private:
  std::optional<InputFile> file_;
  ByteView bytes_;  // the log, or the window of the file
  Bytes window_;
  std::uint64_t window_at_ = 0;
  std::string name_;
  std::uint64_t size_ = 0, position_ = 0;
};

// A little-endian number at an offset; the caller checks that it is inside.
template <class Number>
Number little_endian(ByteView bytes, std::size_t at) {
  static_assert(sizeof(Number) <= 8);
  std::uint64_t raw = 0;
  for (std::size_t i = sizeof(Number); i > 0; --i) raw = raw << 8 | bytes[at + i - 1];
  Number value;
  if constexpr (sizeof(Number) == 8) {
    std::memcpy(&value, &raw, 8);
  } else if constexpr (sizeof(Number) == 4) {
    const auto narrow = static_cast<std::uint32_t>(raw);
    std::memcpy(&value, &narrow, 4);
  } else if constexpr (sizeof(Number) == 2) {
    const auto narrow = static_cast<std::uint16_t>(raw);
    std::memcpy(&value, &narrow, 2);
  } else {
    const auto narrow = static_cast<std::uint8_t>(raw);
    std::memcpy(&value, &narrow, 1);
  }
  return value;
}

}  // namespace nadir
