#include "imagery/cog_tiff.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <set>

namespace nadir {
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
  throw CogError("tiff.corrupt", {.what = "the GeoTIFF is damaged",
                                  .where = name_,
                                  .expected = std::move(expected),
                                  .found = std::move(found),
                                  .fix = "make the file again; a copy of a damaged file stays damaged"});
}

std::uint64_t TiffFile::whole(const std::uint8_t* from, int size) const {
  std::uint64_t value = 0;
  for (int i = 0; i < size; ++i) value = value << 8 | from[big_endian_ ? i : size - 1 - i];
  return value;
}

std::uint64_t TiffFile::whole_at(std::uint64_t at, int size) const {
  std::array<std::uint8_t, 8> raw{};
  if (!bytes_.read(at, std::span(raw).first(static_cast<std::size_t>(size)))) {
    corrupt("places inside the file", fmt::format("one at {} of {} bytes", at, bytes_.size()));
  }
  return whole(raw.data(), size);
}

void TiffFile::read_chain() {
  std::array<std::uint8_t, 4> head{};
  const bool read = bytes_.read(0, head);
  big_endian_ = head[0] == 'M';
  const std::uint64_t version = whole(head.data() + 2, 2);
  if (!read || head[0] != head[1] || (head[0] != 'I' && head[0] != 'M') || (version != 42 && version != 43)) {
    corrupt("a file that begins as TIFF or BigTIFF", bytes_.size() == 0 ? "an empty file" : "other bytes");
  }
  big_ = version == 43;
  if (big_ && (whole_at(4, 2) != 8 || whole_at(6, 2) != 0)) corrupt("a BigTIFF with places of 8 bytes", "others");
  std::set<std::uint64_t> seen;
  for (std::uint64_t at = whole_at(big_ ? 8 : 4, big_ ? 8 : 4); at != 0; at = read_directory(at)) {
    if (!seen.insert(at).second) corrupt("directories one after the other", "a chain that comes back to itself");
    if (seen.size() > kMaxDirectories) corrupt(fmt::format("at most {} directories", kMaxDirectories), "more");
  }
  if (directories_.empty()) corrupt("at least one picture", "none");
}

std::uint64_t TiffFile::read_directory(std::uint64_t at) {
  const int head = big_ ? 8 : 2, wide = big_ ? 8 : 4;
  const std::uint64_t entry = 4 + 2 * static_cast<std::uint64_t>(wide);
  const std::uint64_t count = whole_at(at, head);
  if (count == 0 || count > kMaxFields) {
    corrupt(fmt::format("1 to {} fields in a directory", kMaxFields), std::to_string(count));
  }
  Bytes raw(count * entry);
  const std::uint64_t begin = at + static_cast<std::uint64_t>(head);
  if (!bytes_.read(begin, raw)) corrupt("whole directories", "a file that ends inside of one");
  std::vector<Field>& fields = directories_.emplace_back();
  for (std::uint64_t i = 0; i < count; ++i) {
    const std::uint8_t* from = raw.data() + i * entry;
    Field field{static_cast<std::uint16_t>(whole(from, 2)), static_cast<std::uint16_t>(whole(from + 2, 2)),
                whole(from + 4, wide), begin + i * entry + 4 + static_cast<std::uint64_t>(wide)};
    const auto size = static_cast<std::uint64_t>(size_of(field.type));
    // Short values lie in the entry itself; a count beyond the file is found when the values are asked for.
    if (size != 0 && field.count > static_cast<std::uint64_t>(wide) / size) field.at = whole(from + 4 + wide, wide);
    fields.push_back(field);
  }
  return whole_at(begin + count * entry, wide);
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
    values[i] = whole(raw.data() + i * static_cast<std::size_t>(size), size);
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
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = std::bit_cast<double>(whole(raw.data() + i * 8, 8));
  return values;
}

Bytes TiffFile::bytes(std::size_t directory, std::uint16_t tag, std::uint64_t most) const {
  const Field* field = find(directory, tag);
  if (field == nullptr) return {};
  const bool of_bytes = field->type == kByte || field->type == kAscii || field->type == kUndefined;
  return values_of(*field, of_bytes ? 1 : 0, most);
}

}  // namespace nadir
