// Rows of arbitrary values for SQLite tables, from a fuzzer's bytes.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "imagery/sqlite_database.hpp"

namespace nadir::fuzz {

// Takes values from the front of the bytes; zeros when they are exhausted.
class Source {
 public:
  explicit Source(std::string_view bytes) : bytes_(bytes) {}
  bool empty() const { return bytes_.empty(); }
  std::uint8_t byte() {
    if (bytes_.empty()) return 0;
    const auto value = static_cast<std::uint8_t>(bytes_.front());
    bytes_.remove_prefix(1);
    return value;
  }
  std::string_view text() {
    const std::size_t low = byte(),
                      wanted = low + std::size_t{256} * byte();  // both bytes, before what is left is asked
    const std::string_view value = bytes_.substr(0, wanted);
    bytes_.remove_prefix(value.size());
    return value;
  }

 private:
  std::string_view bytes_;
};

// One column's value, of any of SQLite's types: SQLite does not enforce the schema's types.
inline void bind_any(SqliteStatement& statement, int column, Source& source) {
  static constexpr std::array<std::int64_t, 9> kExtremes{INT64_MIN, -1,        24,          25,       1 << 24,
                                                         INT32_MAX, 1LL << 32, (1LL << 53), INT64_MAX};
  switch (const std::uint8_t kind = source.byte(); kind % 8) {
    case 0: statement.bind_null(column); break;
    case 1: statement.bind(column, source.text()); break;
    case 2: statement.bind(column, as_bytes(source.text())); break;
    case 3: statement.bind(column, kExtremes.at(source.byte() % kExtremes.size())); break;
    case 4: statement.bind(column, std::int64_t{source.byte()} << (source.byte() % 56)); break;
    default: statement.bind(column, std::int64_t{kind / 8}); break;
  }
}

}  // namespace nadir::fuzz
