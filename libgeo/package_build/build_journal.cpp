#include "package_build/build_journal.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <functional>
#include <span>
#include <vector>

#include "base/digest.hpp"
#include "base/error.hpp"

namespace nadir {
namespace {

constexpr std::uint64_t kMaxRecord = std::uint64_t{1} << 28;
constexpr std::size_t kLengthBytes = 8;
constexpr std::size_t kHeadBytes = kLengthBytes + sizeof(Sha256::bytes);

std::vector<std::string_view> lines_of(std::string_view text) {
  std::vector<std::string_view> lines;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    lines.push_back(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return lines;
}

// The first line that only one of the two has.
std::string difference(std::string_view text, std::string_view other) {
  const auto others = lines_of(other);
  for (const std::string_view line : lines_of(text)) {
    if (std::find(others.begin(), others.end(), line) == others.end()) return std::string(line);
  }
  return "no such line";
}

// read: fills the target, false when fewer bytes are left. rest: the number of bytes that are left.
std::optional<Bytes> whole_record(const std::function<bool(std::span<std::uint8_t>)>& read,
                                  const std::function<std::uint64_t()>& rest) {
  std::array<std::uint8_t, kHeadBytes> head{};
  if (!read(head)) return std::nullopt;
  std::uint64_t length = 0;
  for (std::size_t i = 0; i < kLengthBytes; ++i) length = length << 8 | head[i];
  if (length > std::min(kMaxRecord, rest())) return std::nullopt;
  Bytes record(length);
  if (!read(record)) return std::nullopt;
  const Sha256 digest = sha256(record);
  if (!std::equal(digest.bytes.begin(), digest.bytes.end(), head.begin() + kLengthBytes)) return std::nullopt;
  return record;
}

}  // namespace

BuildJournal::BuildJournal(const std::filesystem::path& path, std::string_view configuration)
    : path_(path), file_(path) {
  const std::optional<Bytes> before = read_record();
  if (!before) {
    file_.cut(0);
    add(as_bytes(configuration));
    return;
  }
  if (as_text(*before) == configuration) return;
  const auto [expected, found] = difference_of(as_text(*before), configuration);
  throw UsageError({.what = "the interrupted build had other inputs or options",
                    .where = path.string(),
                    .expected = expected,
                    .found = found,
                    .fix = "resume with the same inputs and options, or build from the start without --resume"});
}

std::optional<Bytes> BuildJournal::read_record() {
  return whole_record([this](std::span<std::uint8_t> target) { return file_.read(target); },
                      [this] { return file_.size() - file_.position(); });
}

std::optional<Bytes> BuildJournal::next() {
  const std::uint64_t begin = file_.position();
  std::optional<Bytes> record = read_record();
  if (!record) file_.cut(begin);
  return record;
}

void BuildJournal::add(ByteView record) {
  Bytes bytes;
  bytes.reserve(kHeadBytes + record.size());
  for (std::size_t i = 0; i < kLengthBytes; ++i) {
    bytes.push_back(static_cast<std::uint8_t>(std::uint64_t{record.size()} >> (8 * (kLengthBytes - 1 - i))));
  }
  const Sha256 digest = sha256(record);
  bytes.insert(bytes.end(), digest.bytes.begin(), digest.bytes.end());
  bytes.insert(bytes.end(), record.begin(), record.end());
  file_.append(bytes);
}

JournalReader::JournalReader(const std::filesystem::path& path) : file_(path) {
  if (const auto first = next()) configuration_ = as_text(*first);
  if (!configuration_.empty()) return;
  throw Error({.what = "this is no journal of a build", .where = path.string(), .found = "no configuration"});
}

std::optional<Bytes> JournalReader::next() {
  if (position_ == file_.size()) return std::nullopt;
  const std::uint64_t begin = position_;
  auto record = whole_record(
      [this](std::span<std::uint8_t> target) {
        if (!file_.read_at(position_, target)) return false;
        position_ += target.size();
        return true;
      },
      [this] { return file_.size() - position_; });
  if (record) return record;
  throw Error({.what = "a journal of a build is damaged",
               .where = fmt::format("{} (byte {})", file_.path().string(), begin),
               .expected = "a record with the SHA-256 of its bytes",
               .fix = "copy the file again, or remove it and make it again"});
}

ConfigurationDifference difference_of(std::string_view expected, std::string_view found) {
  return {difference(expected, found), difference(found, expected)};
}

}  // namespace nadir
