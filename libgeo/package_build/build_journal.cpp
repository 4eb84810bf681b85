#include "package_build/build_journal.hpp"

#include <algorithm>
#include <array>
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

}  // namespace

BuildJournal::BuildJournal(const std::filesystem::path& path, std::string_view configuration) : file_(path) {
  const std::optional<Bytes> before = read_record();
  if (!before) {
    file_.cut(0);
    add(as_bytes(configuration));
    return;
  }
  if (as_text(*before) == configuration) return;
  throw UsageError({.what = "the interrupted build had other inputs or options",
                    .where = path.string(),
                    .expected = difference(as_text(*before), configuration),
                    .found = difference(configuration, as_text(*before)),
                    .fix = "resume with the same inputs and options, or build from the start without --resume"});
}

std::optional<Bytes> BuildJournal::read_record() {
  std::array<std::uint8_t, kHeadBytes> head{};
  if (!file_.read(head)) return std::nullopt;
  std::uint64_t length = 0;
  for (std::size_t i = 0; i < kLengthBytes; ++i) length = length << 8 | head[i];
  if (length > std::min(kMaxRecord, file_.size() - file_.position())) return std::nullopt;
  Bytes record(length);
  if (!file_.read(record)) return std::nullopt;
  const Sha256 digest = sha256(record);
  if (!std::equal(digest.bytes.begin(), digest.bytes.end(), head.begin() + kLengthBytes)) return std::nullopt;
  return record;
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

}  // namespace nadir
