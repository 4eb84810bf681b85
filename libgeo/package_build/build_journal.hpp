// The progress of a build on disk, so that an interrupted build can be resumed: its configuration, then one record per
// metatile in the order in which they are written.
//
// A record is 8 bytes of length (big endian), the SHA-256 of the bytes, then the bytes. Whatever follows the last
// complete record is cut off.
#pragma once

#include <filesystem>
#include <optional>
#include <string_view>

#include "base/bytes.hpp"
#include "base/files.hpp"

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

 private:
  std::optional<Bytes> read_record();

  AppendFile file_;
};

}  // namespace nadir
