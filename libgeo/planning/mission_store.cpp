#include "planning/mission_store.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "base/files.hpp"
#include "base/json.hpp"
#include "package/mission_yaml.hpp"
#include "planning/mission_document.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr const char* kDraftFile = "draft.json";
constexpr std::string_view kDraftSchema = "nadir.draft/1";
constexpr std::uint64_t kMaxDraft = std::uint64_t{16} << 20;
constexpr std::size_t kMissionIdDigits = 12;

// The file's own text while it means the same; a mission that was edited is written anew.
std::string text_of(const MissionReading& reading, std::string_view original) {
  if (!reading.mission) return {};
  if (!original.empty()) {
    const MissionReading before = parse_mission(original, "mission.yaml");
    if (before.mission && *before.mission == *reading.mission) return std::string(original);
  }
  return mission_yaml(*reading.mission);
}

StoredMission parse_draft(std::string id, const fs::path& file) {
  const json draft = parse_json(read_text_file(file, kMaxDraft), file.string());
  const JsonReader in(draft, {.name = file.string(), .what = "cannot read this mission"});
  in.expect("schema", kDraftSchema);
  StoredMission mission;
  mission.id = std::move(id);
  mission.revision = in.integer("revision", 1, std::int64_t{1} << 53);
  mission.changed = in.time("changed");
  const json& document = in.object("mission").json();
  mission.document = document.dump();
  mission.reading = read_document(document);
  mission.text = text_of(mission.reading, in.text("text"));
  return mission;
}

}  // namespace

MissionStore::MissionStore(fs::path folder, std::size_t most, std::function<UtcTime()> now,
                           std::function<std::string()> new_id)
    : folder_(std::move(folder)), most_(most), now_(std::move(now)), new_id_(std::move(new_id)) {
  std::error_code code;
  fs::create_directories(folder_, code);
  if (code) {
    throw Error({.what = "cannot create the folder of missions",
                 .where = folder_.string(),
                 .found = code.message(),
                 .fix = "check the owner of the folder above it, and its disk"});
  }
}

bool MissionStore::is_id(std::string_view id) {
  return id.size() == kMissionIdDigits && id.find_first_not_of("0123456789abcdef") == std::string_view::npos;
}

StoredMission MissionStore::put(const std::string& id, std::int64_t revision, const json& document,
                                std::string_view text) const {
  StoredMission mission;
  mission.id = id;
  mission.revision = revision;
  mission.changed = now_();
  mission.document = document.dump(-1, ' ', false, json::error_handler_t::replace);
  mission.reading = read_document(document);
  mission.text = text_of(mission.reading, text);
  const json draft = {{"schema", kDraftSchema},
                      {"revision", revision},
                      {"changed", to_rfc3339(mission.changed)},
                      {"text", mission.text},
                      {"mission", document}};
  write_file_atomic(folder_ / id / kDraftFile, draft.dump(-1, ' ', false, json::error_handler_t::replace) + "\n");
  return mission;
}

StoredMission MissionStore::create(const json& document, std::string_view text) {
  const std::lock_guard lock(mutex_);
  std::size_t missions = 0;
  for (const auto& entry : fs::directory_iterator(folder_)) missions += is_id(entry.path().filename().string());
  if (missions >= most_) {
    throw UsageError({.what = "the desk has too many missions",
                      .expected = "at most " + std::to_string(most_),
                      .fix = "delete missions that are not needed any more"});
  }
  std::string id = new_id_();
  while (!fs::create_directory(folder_ / id)) id = new_id_();
  return put(id, 1, document, text);
}

std::optional<StoredMission> MissionStore::find(std::string_view id) const {
  std::error_code code;
  if (!is_id(id) || !fs::is_regular_file(folder_ / id / kDraftFile, code)) return std::nullopt;
  return parse_draft(std::string(id), folder_ / id / kDraftFile);
}

std::vector<StoredMission> MissionStore::list() const {
  std::vector<StoredMission> missions;
  for (const auto& entry : fs::directory_iterator(folder_)) {
    try {
      if (auto mission = find(entry.path().filename().string())) missions.push_back(*std::move(mission));
    } catch (const Error&) {
      continue;  // a damaged one does not hide the others; opening it says what is wrong
    }
  }
  std::sort(missions.begin(), missions.end(), [](const StoredMission& a, const StoredMission& b) {
    return std::pair(b.changed, a.id) < std::pair(a.changed, b.id);
  });
  return missions;
}

StoredMission MissionStore::write(std::string_view id, std::int64_t revision, const json& document) {
  const std::lock_guard lock(mutex_);
  const auto before = find(id);
  if (!before) throw Error({.what = "there is no mission of this id", .where = std::string(id)});
  if (before->revision != revision) {
    throw RevisionConflict({.what = "the mission was changed meanwhile",
                            .expected = "revision " + std::to_string(before->revision),
                            .found = "revision " + std::to_string(revision),
                            .fix = "read it again, and make the change there"});
  }
  return put(before->id, revision + 1, document, before->text);
}

bool MissionStore::remove(std::string_view id) {
  const std::lock_guard lock(mutex_);
  std::error_code code;
  if (!is_id(id) || !fs::is_directory(folder_ / id, code)) return false;
  fs::remove(folder_ / id / kDraftFile);  // first: what is left of a killed removal is no mission
  fs::remove_all(folder_ / id);
  return true;
}

}  // namespace nadir
