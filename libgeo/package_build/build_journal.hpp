// The progress of a build on disk, so that an interrupted build can be resumed: its configuration, then one record per
// metatile in the order in which they are written.
//
// A finished journal is also what a shard of a build hands on (build_shards.hpp).
//
// A record is 8 bytes of length (big endian), the SHA-256 of the bytes, then the bytes. Whatever follows the last
// complete record is cut off.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "base/bytes.hpp"
#include "base/files.hpp"
#include "base/input_file.hpp"

namespace nadir {

inline constexpr const char* kJournalFile = "build.journal";

class BuildJournal {
 public:
  // configuration: lines "name: value" of everything that the result depends on. Throws UsageError, and leaves the
  // file unchanged, when it belongs to another configuration. A file without a complete configuration is restarted.
  BuildJournal(const std::filesystem::path& path, std::string_view configuration);

  // The next complete record; nullopt at the end, and from then on add() may be called.
  std::optional<Bytes> next();
  void add(ByteView record);

  const std::filesystem::path& path() const { return path_; }

 private:
  std::optional<Bytes> read_record();

  std::filesystem::path path_;
  AppendFile file_;
};

// A journal that nobody writes to any more.
class JournalReader {
 public:
  // Throws Error when the file cannot be read or does not begin with a configuration.
  explicit JournalReader(const std::filesystem::path& path);

  const std::string& configuration() const { return configuration_; }
  // The next record; nullopt at the end of the file. Throws Error for bytes that are no whole record.
  std::optional<Bytes> next();

 private:
  InputFile file_;
  std::uint64_t position_ = 0;
  std::string configuration_;
};

// For messages: the first line of each configuration that the other one lacks.
struct ConfigurationDifference {
  std::string expected, found;
};
ConfigurationDifference difference_of(std::string_view expected, std::string_view found);

}  // namespace nadir
