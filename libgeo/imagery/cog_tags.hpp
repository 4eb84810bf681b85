// One directory of a TIFF file, to be written: little-endian, classic or BigTIFF.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string_view>

#include "base/bytes.hpp"

namespace nadir {

class TiffTags {
 public:
  explicit TiffTags(bool big) : big_(big) {}

  void shorts(std::uint16_t tag, std::initializer_list<std::uint16_t> values);
  void longs(std::uint16_t tag, std::span<const std::uint32_t> values);
  void long_(std::uint16_t tag, std::uint32_t value) { longs(tag, {&value, 1}); }
  void places(std::uint16_t tag, std::span<const std::uint64_t> values);  // LONG, or LONG8 in a BigTIFF
  void doubles(std::uint16_t tag, std::initializer_list<double> values);
  void text(std::uint16_t tag, std::string_view value);
  void undefined(std::uint16_t tag, ByteView value);

  // Of the directory and of the values that lie behind it. Even.
  std::uint64_t size() const;
  // The bytes, to lie at this place of the file; next: where the following directory begins, 0 when there is none.
  Bytes write(std::uint64_t at, std::uint64_t next) const;

 private:
  struct Field {
    std::uint16_t type = 0;
    std::uint64_t count = 0;
    Bytes values;
  };
  std::uint64_t table_size() const;

  bool big_;
  std::map<std::uint16_t, Field> fields_;  // a directory is sorted by tag
};

// The first bytes of a file whose first directory lies at this place: 8, in a BigTIFF 16.
Bytes tiff_header(bool big, std::uint64_t first_directory);

}  // namespace nadir
