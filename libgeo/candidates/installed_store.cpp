#include "candidates/installed_store.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/json.hpp"
#include "candidates/pack_store.hpp"

namespace nadir {

namespace fs = std::filesystem;

namespace {

constexpr const char* kRecordSchema = "nadir.installed-record/1";
constexpr std::uint64_t kMaxRecordSize = 2 * kMaxInstalledSize;
constexpr std::string_view kRecordEnding = ".json";

std::string record_json(const InstalledRecord& record) {
  return nlohmann::json{{"schema", kRecordSchema},
                        {"received_at", to_rfc3339(record.received_at)},
                        {"highest_sequence", record.highest_sequence},
                        {"report", nlohmann::json::parse(record.report.json())}}
             .dump(1) +
         "\n";
}

}  // namespace

InstalledRecord parse_installed_record(std::string_view text, std::string_view name) {
  const nlohmann::json document = parse_json(text, name, {.max_depth = 5, .allow_floats = false});
  const JsonReader in(document, {.name = std::string(name), .what = "cannot read this record of an aircraft's report"});
  in.expect("schema", kRecordSchema);
  InstalledRecord record{.report = parse_installed_report(in.object("report").json().dump(), name),
                         .received_at = in.time("received_at")};
  record.highest_sequence = in.integer("highest_sequence", 0, std::int64_t{1} << 53);
  in.finish();
  return record;
}

// A name of letters, digits, '.', '_' and '-' (parse_installed_report()), with an ending: never a path.
fs::path InstalledStore::path_of(const std::string& airframe) const {
  return folder_ / (airframe + std::string(kRecordEnding));
}

std::optional<InstalledRecord> InstalledStore::last_of(const std::string& airframe) const {
  const fs::path path = path_of(airframe);
  if (!fs::exists(fs::symlink_status(path))) return std::nullopt;
  return parse_installed_record(read_text_file(path, kMaxRecordSize), path.string());
}

InstalledStore::Outcome InstalledStore::put(const SignedInstalledReport& report, const TrustRoot& root, UtcTime now) {
  const std::lock_guard lock(mutex_);
  InstalledRecord record{.report = report, .received_at = now, .highest_sequence = report.report.sequence};
  std::optional<InstalledRecord> last;
  try {
    last = last_of(report.report.airframe);
  } catch (const Error&) {  // truncated, or edited by hand: any signed report is better than none
  }
  if (last) {
    if (last->report.document.signed_bytes == report.document.signed_bytes) return Outcome::known;
    const bool still_trusted = !check_installed_signature(root, last->report, std::nullopt).findings.has_errors();
    if (still_trusted && report.report.number <= last->report.report.number) return Outcome::older;
    if (still_trusted && last->report.report.series == report.report.series) {
      record.highest_sequence = std::max(record.highest_sequence, last->highest_sequence);
    }
  }
  make_folder(folder_);
  write_file_atomic(path_of(report.report.airframe), record_json(record));
  return Outcome::stored;
}

std::vector<InstalledStore::Entry> InstalledStore::list() const {
  const std::lock_guard lock(mutex_);
  std::vector<Entry> entries;
  std::error_code none;
  for (fs::directory_iterator file(folder_, none), end; file != end; file.increment(none)) {
    const std::string name = file->path().filename().string();
    if (!name.ends_with(kRecordEnding)) continue;
    Entry entry{.airframe = name.substr(0, name.size() - kRecordEnding.size())};
    try {
      entry.record = last_of(entry.airframe);
      if (entry.record && entry.record->report.report.airframe != entry.airframe) {
        entry.record.reset();
        entry.damage = "a report of another airframe";
      }
    } catch (const Error& error) {
      entry.damage = error.text().found.empty() ? error.text().what : error.text().found;
    }
    entries.push_back(std::move(entry));
  }
  std::sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) { return a.airframe < b.airframe; });
  return entries;
}

bool InstalledStore::forget(const std::string& airframe) {
  const std::lock_guard lock(mutex_);
  std::error_code none;
  for (fs::directory_iterator file(folder_, none), end; file != end; file.increment(none)) {
    if (file->path().filename() != airframe + std::string(kRecordEnding)) continue;
    fs::remove(file->path());
    sync_to_disk(folder_);
    return true;
  }
  return false;
}

}  // namespace nadir
