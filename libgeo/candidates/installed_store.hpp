// What each aircraft reported last (trust/installed_report.hpp): DATA/installed/AIRFRAME.json, replaced in one step. A
// report is kept with its signature, so that the list can be checked again by anybody.
//
// A report with a number that is not above the last one's changes nothing, unless the last one's key is no longer the
// airframe's: then whoever holds the lost key has counted, and the aircraft begins anew. For any thread.
#pragma once

#include <cstdint>
#include <filesystem>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "trust/installed_report.hpp"

namespace nadir {

// A stored report: {"schema": "nadir.installed-record/1", "received_at", "highest_sequence", "report": {…}}
struct InstalledRecord {
  SignedInstalledReport report;
  UtcTime received_at;                // by the service's clock
  std::int64_t highest_sequence = 0;  // of the report's series, over its reports one after the other

  // The aircraft flies an older package of the series than it reported before.
  bool went_back() const { return report.report.sequence < highest_sequence; }
};

// Form only; throws Error.
InstalledRecord parse_installed_record(std::string_view text, std::string_view name);

class InstalledStore {
 public:
  explicit InstalledStore(std::filesystem::path folder) : folder_(std::move(folder)) {}

  enum class Outcome { stored, known, older };
  // report: its signature is checked. Throws OutOfSpace, Error.
  Outcome put(const SignedInstalledReport& report, const TrustRoot& root, UtcTime now);

  struct Entry {
    std::string airframe;
    std::optional<InstalledRecord> record{};  // none: the file is damaged,
    std::string damage{};                     // and how
  };
  std::vector<Entry> list() const;  // by airframe

  // The documented way back: the airframe's next report is taken whatever its number. False: there was none.
  bool forget(const std::string& airframe);

 private:
  std::filesystem::path path_of(const std::string& airframe) const;
  std::optional<InstalledRecord> last_of(const std::string& airframe) const;

  const std::filesystem::path folder_;
  mutable std::mutex mutex_;
};

}  // namespace nadir
