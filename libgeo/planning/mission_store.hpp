// Missions that are being planned, a folder each: ROOT/ID/draft.json holds the document (mission_document.hpp) with its
// revision; beside it lies what jobs make of it.
//
// A mission may be incomplete at any time; it is kept as it is. Whatever a call has returned is on the disk. A mission
// that was imported as a file keeps that file's text, to the byte, as long as the document says the same.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <mutex>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.hpp"
#include "base/time.hpp"
#include "package/mission.hpp"

namespace nadir {

struct StoredMission {
  std::string id;  // 12 hexadecimal digits
  std::int64_t revision = 0;
  UtcTime changed;
  std::string document;    // JSON
  std::string text;        // as mission.yaml; empty while it is not valid
  MissionReading reading;  // paths in the document
};

// Somebody else has changed the mission since.
class RevisionConflict : public Error {
 public:
  using Error::Error;
};

class MissionStore {
 public:
  // Creates the folder. Throws Error when it cannot be written.
  MissionStore(std::filesystem::path folder, std::size_t most, std::function<UtcTime()> now,
               std::function<std::string()> new_id);

  // text: mission.yaml where the document comes from one. Throws UsageError when there are too many, OutOfSpace.
  StoredMission create(const nlohmann::json& document, std::string_view text = {});
  std::optional<StoredMission> find(std::string_view id) const;
  std::vector<StoredMission> list() const;  // the last changed first; those that cannot be read are left out
  // Throws RevisionConflict when the mission's revision is another one, Error when there is none.
  StoredMission write(std::string_view id, std::int64_t revision, const nlohmann::json& document);
  bool remove(std::string_view id);  // false: there is none

  std::filesystem::path folder_of(std::string_view id) const { return folder_ / id; }
  static bool is_id(std::string_view id);

 private:
  StoredMission put(const std::string& id, std::int64_t revision, const nlohmann::json& document,
                    std::string_view text) const;

  const std::filesystem::path folder_;
  const std::size_t most_;
  const std::function<UtcTime()> now_;
  const std::function<std::string()> new_id_;
  mutable std::mutex mutex_;  // of changes
};

}  // namespace nadir
