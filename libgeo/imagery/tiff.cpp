#include "imagery/tiff.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <set>

namespace nadir {

bool FileBytes::read(std::uint64_t at, std::span<std::uint8_t> target) const {
  if (at > size() || target.size() > size() - at) return false;
  try {
    return file_.read_at(at, target);
  } catch (const Error& error) {
    throw TiffError("tiff.corrupt", {.what = "cannot read the tile set",
                                     .where = file_.path().string(),
                                     .found = error.text().found,
                                     .fix = "check the storage medium"});
  }
}

bool MemoryBytes::read(std::uint64_t at, std::span<std::uint8_t> target) const {
  if (at > bytes_.size() || target.size() > bytes_.size() - at) return false;
  std::copy_n(bytes_.begin() + static_cast<std::ptrdiff_t>(at), target.size(), target.begin());
  return true;
}

namespace {

constexpr std::size_t kMaxDirectories = 64;  // twice the zooms that there are, with masks
constexpr std::uint64_t kMaxFields = 1024;

enum Type : std::uint16_t { kByte = 1, kAscii = 2, kShort = 3, kLong = 4, kUndefined = 7, kDouble = 12, kLong8 = 16 };

int size_of_number(std::uint16_t type) {
  return type == kByte ? 1 : type == kShort ? 2 : type == kLong ? 4 : type == kLong8 ? 8 : 0;
}

int size_of(std::uint16_t type) {
  constexpr std::array<std::uint8_t, 19> kSizes{0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8, 4, 0, 0, 8, 8, 8};
  return type < kSizes.size() ? kSizes[type] : 0;
}

}  // namespace

TiffFile::TiffFile(const RandomBytes& bytes, std::string name) : bytes_(bytes), name_(std::move(name)) { read_chain(); }

void TiffFile::corrupt(std::string expected, std::string found) const {
  throw TiffError("tiff.corrupt", {.what = "the GeoTIFF is damaged",
                                   .where = name_,
                                   .expected = std::move(expected),
                                   .found = std::move(found),
                                   .fix = "create the file again; copies of a damaged file are damaged as well"});
}

std::uint64_t TiffFile::integer(const std::uint8_t* from, int size) const {
  std::uint64_t value = 0;
  for (int i = 0; i < size; ++i) value = value << 8 | from[big_endian_ ? i : size - 1 - i];
  return value;
}

std::uint64_t TiffFile::integer_at(std::uint64_t at, int size) const {
  std::array<std::uint8_t, 8> raw{};
  if (!bytes_.read(at, std::span(raw).first(static_cast<std::size_t>(size)))) {
    corrupt("offsets inside the file", fmt::format("{} of {} bytes", at, bytes_.size()));
  }
  return integer(raw.data(), size);
}

void TiffFile::read_chain() {
  std::array<std::uint8_t, 4> head{};
  const bool read = bytes_.read(0, head);
  big_endian_ = head[0] == 'M';
  const std::uint64_t version = integer(head.data() + 2, 2);
  if (!read || head[0] != head[1] || (head[0] != 'I' && head[0] != 'M') || (version != 42 && version != 43)) {
    corrupt("a file that begins as TIFF or BigTIFF", bytes_.size() == 0 ? "an empty file" : "different bytes");
  }
  big_ = version == 43;
  if (big_ && (integer_at(4, 2) != 8 || integer_at(6, 2) != 0)) corrupt("a BigTIFF with offsets of 8 bytes", "others");
  std::set<std::uint64_t> seen;
  for (std::uint64_t at = integer_at(big_ ? 8 : 4, big_ ? 8 : 4); at != 0; at = read_directory(at)) {
    if (!seen.insert(at).second) corrupt("a chain of directories without a loop", "a loop");
    if (seen.size() > kMaxDirectories) corrupt(fmt::format("at most {} directories", kMaxDirectories), "more");
  }
  if (directories_.empty()) corrupt("at least one image", "none");
}

std::uint64_t TiffFile::read_directory(std::uint64_t at) {
  const int head = big_ ? 8 : 2, wide = big_ ? 8 : 4;
  const std::uint64_t entry = 4 + 2 * static_cast<std::uint64_t>(wide);
  const std::uint64_t count = integer_at(at, head);
  if (count == 0 || count > kMaxFields) {
    corrupt(fmt::format("1 to {} fields in a directory", kMaxFields), std::to_string(count));
  }
  Bytes raw(count * entry);
  const std::uint64_t begin = at + static_cast<std::uint64_t>(head);
  if (!bytes_.read(begin, raw)) corrupt("complete directories", "a file that ends inside one");
  std::vector<Field>& fields = directories_.emplace_back();
  for (std::uint64_t i = 0; i < count; ++i) {
    const std::uint8_t* from = raw.data() + i * entry;
    Field field{static_cast<std::uint16_t>(integer(from, 2)), static_cast<std::uint16_t>(integer(from + 2, 2)),
                integer(from + 4, wide), begin + i * entry + 4 + static_cast<std::uint64_t>(wide)};
    const auto size = static_cast<std::uint64_t>(size_of(field.type));
    // Short values lie in the entry itself; a count beyond the file is found when the values are asked for.
    if (size != 0 && field.count > static_cast<std::uint64_t>(wide) / size) field.at = integer(from + 4 + wide, wide);
    fields.push_back(field);
  }
  return integer_at(begin + count * entry, wide);
}

const TiffFile::Field* TiffFile::find(std::size_t directory, std::uint16_t tag) const {
  const auto& fields = directories_.at(directory);
  const auto found = std::find_if(fields.begin(), fields.end(), [tag](const Field& field) { return field.tag == tag; });
  return found == fields.end() ? nullptr : &*found;
}

Bytes TiffFile::values_of(const Field& field, int size, std::uint64_t most) const {
  if (size == 0) corrupt(fmt::format("tag {} of another type", field.tag), fmt::format("type {}", field.type));
  if (field.count > most || field.count > bytes_.size() / static_cast<std::uint64_t>(size)) {
    corrupt(fmt::format("at most {} values of tag {}", most, field.tag), std::to_string(field.count));
  }
  Bytes raw(field.count * static_cast<std::uint64_t>(size));
  if (!bytes_.read(field.at, raw)) {
    corrupt(fmt::format("values of tag {} inside the file", field.tag), fmt::format("at {}", field.at));
  }
  return raw;
}

std::vector<std::uint64_t> TiffFile::numbers(std::size_t directory, std::uint16_t tag, std::uint64_t most) const {
  const Field* field = find(directory, tag);
  if (field == nullptr) return {};
  const int size = size_of_number(field->type);
  const Bytes raw = values_of(*field, size, most);
  std::vector<std::uint64_t> values(field->count);
  for (std::size_t i = 0; i < values.size(); ++i) {
    values[i] = integer(raw.data() + i * static_cast<std::size_t>(size), size);
  }
  return values;
}

std::uint64_t TiffFile::number(std::size_t directory, std::uint16_t tag, std::uint64_t absent) const {
  const auto values = numbers(directory, tag);
  return values.empty() ? absent : values.front();
}

std::vector<double> TiffFile::reals(std::size_t directory, std::uint16_t tag, std::uint64_t most) const {
  const Field* field = find(directory, tag);
  if (field == nullptr) return {};
  const Bytes raw = values_of(*field, field->type == kDouble ? 8 : 0, most);
  std::vector<double> values(field->count);
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = std::bit_cast<double>(integer(raw.data() + i * 8, 8));
  return values;
}

Bytes TiffFile::bytes(std::size_t directory, std::uint16_t tag, std::uint64_t most) const {
  const Field* field = find(directory, tag);
  if (field == nullptr) return {};
  const bool of_bytes = field->type == kByte || field->type == kAscii || field->type == kUndefined;
  return values_of(*field, of_bytes ? 1 : 0, most);
}

namespace {

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
