// Numbers and texts as MCAP has them: little-endian, texts and maps with a length of 32 bits before them.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>

#include "base/bytes.hpp"

namespace nadir {

class McapBytes {
 public:
  template <typename Number>
  void number(Number value) {
    for (std::size_t i = 0; i < sizeof(Number); ++i) {
      bytes_.push_back(static_cast<std::uint8_t>(static_cast<std::uint64_t>(value) >> (8 * i)));
    }
  }
  void raw(ByteView bytes) { bytes_.insert(bytes_.end(), bytes.begin(), bytes.end()); }
  void text(std::string_view text) {
    number(static_cast<std::uint32_t>(text.size()));
    raw(as_bytes(text));
  }
  // A record around its content.
  void record(std::uint8_t opcode, ByteView content) {
    number(opcode);
    number(static_cast<std::uint64_t>(content.size()));
    raw(content);
  }

  const Bytes& bytes() const { return bytes_; }
  std::size_t size() const { return bytes_.size(); }
  bool empty() const { return bytes_.empty(); }
  void clear() { bytes_.clear(); }

 private:
  Bytes bytes_;
};

// Reads from the front. What is not there reads as zero and makes ok() false for good: a reader asks once, at the end.
class McapCursor {
 public:
  explicit McapCursor(ByteView bytes) : left_(bytes) {}

  template <typename Number>
  Number number() {
    std::uint64_t value = 0;
    const ByteView bytes = raw(sizeof(Number));
    for (std::size_t i = 0; i < bytes.size(); ++i) value |= static_cast<std::uint64_t>(bytes[i]) << (8 * i);
    return static_cast<Number>(value);
  }
  ByteView raw(std::uint64_t size) {
    if (size > left_.size()) {
      ok_ = false;
      left_ = {};
      return {};
    }
    const ByteView bytes = left_.first(static_cast<std::size_t>(size));
    left_ = left_.subspan(static_cast<std::size_t>(size));
    return bytes;
  }
  std::string text() { return std::string(as_text(raw(number<std::uint32_t>()))); }
  // The bytes of a map or an array, whose length in bytes stands before it.
  McapCursor sized() {
    McapCursor inner(raw(number<std::uint32_t>()));
    if (!ok_) inner.ok_ = false;
    return inner;
  }

  bool ok() const { return ok_; }
  bool done() const { return left_.empty(); }
  ByteView rest() { return raw(left_.size()); }

 private:
  ByteView left_;
  bool ok_ = true;
};

}  // namespace nadir
