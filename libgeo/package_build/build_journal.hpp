// What a build has done so far, so that a killed one can go on: its configuration, then one record for each metatile in
// the order in which they are written. Records are whole or not at all (length and digest before the bytes); what
// follows the last whole one is cut off.
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
  // file as it is, when it belongs to another configuration. One without a whole configuration begins anew.
  BuildJournal(const std::filesystem::path& path, std::string_view configuration);

  // The next whole record; nullopt at their end, and from then on add() may be called.
  std::optional<Bytes> next();
  void add(ByteView record);

 private:
  std::optional<Bytes> read_record();

  AppendFile file_;
};

}  // namespace nadir
