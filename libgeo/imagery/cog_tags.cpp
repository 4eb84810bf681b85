#include "imagery/cog_tags.hpp"

#include <bit>

namespace nadir {
namespace {

enum Type : std::uint16_t { kAscii = 2, kShort = 3, kLong = 4, kUndefined = 7, kDouble = 12, kLong8 = 16 };

void append(Bytes& out, std::uint64_t value, int size) {
  for (int i = 0; i < size; ++i) out.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
}

std::uint64_t even(std::uint64_t size) { return size + size % 2; }

}  // namespace

void TiffTags::shorts(std::uint16_t tag, std::initializer_list<std::uint16_t> values) {
  Field& field = fields_[tag] = {kShort, values.size(), {}};
  for (const std::uint16_t value : values) append(field.values, value, 2);
}

void TiffTags::longs(std::uint16_t tag, std::span<const std::uint32_t> values) {
  Field& field = fields_[tag] = {kLong, values.size(), {}};
  field.values.reserve(values.size() * 4);
  for (const std::uint32_t value : values) append(field.values, value, 4);
}

void TiffTags::places(std::uint16_t tag, std::span<const std::uint64_t> values) {
  Field& field = fields_[tag] = {static_cast<std::uint16_t>(big_ ? kLong8 : kLong), values.size(), {}};
  field.values.reserve(values.size() * (big_ ? 8 : 4));
  for (const std::uint64_t value : values) append(field.values, value, big_ ? 8 : 4);
}

void TiffTags::doubles(std::uint16_t tag, std::initializer_list<double> values) {
  Field& field = fields_[tag] = {kDouble, values.size(), {}};
  for (const double value : values) append(field.values, std::bit_cast<std::uint64_t>(value), 8);
}

void TiffTags::text(std::uint16_t tag, std::string_view value) {
  Field& field = fields_[tag] = {kAscii, value.size() + 1, {value.begin(), value.end()}};
  field.values.push_back(0);
}

void TiffTags::undefined(std::uint16_t tag, ByteView value) {
  fields_[tag] = {kUndefined, value.size(), {value.begin(), value.end()}};
}

std::uint64_t TiffTags::table_size() const { return big_ ? 8 + 20 * fields_.size() + 8 : 2 + 12 * fields_.size() + 4; }

std::uint64_t TiffTags::size() const {
  std::uint64_t size = even(table_size());
  for (const auto& [tag, field] : fields_) {
    if (field.values.size() > (big_ ? 8U : 4U)) size += even(field.values.size());
  }
  return size;
}

Bytes TiffTags::write(std::uint64_t at, std::uint64_t next) const {
  const int wide = big_ ? 8 : 4;
  std::uint64_t place = at + even(table_size());
  Bytes table, values;
  append(table, fields_.size(), big_ ? 8 : 2);
  for (const auto& [tag, field] : fields_) {
    append(table, tag, 2);
    append(table, field.type, 2);
    append(table, field.count, wide);
    if (field.values.size() <= static_cast<std::size_t>(wide)) {
      Bytes inside = field.values;
      inside.resize(static_cast<std::size_t>(wide), 0);
      table.insert(table.end(), inside.begin(), inside.end());
    } else {
      append(table, place, wide);
      values.insert(values.end(), field.values.begin(), field.values.end());
      if (values.size() % 2 != 0) values.push_back(0);
      place = at + even(table_size()) + values.size();
    }
  }
  append(table, next, wide);
  if (table.size() % 2 != 0) table.push_back(0);
  table.insert(table.end(), values.begin(), values.end());
  return table;
}

Bytes tiff_header(bool big, std::uint64_t first_directory) {
  Bytes head{'I', 'I', static_cast<std::uint8_t>(big ? 43 : 42), 0};
  if (big) append(head, 8, 4);  // places of 8 bytes, then two of nothing
  append(head, first_directory, big ? 8 : 4);
  return head;
}

}  // namespace nadir
