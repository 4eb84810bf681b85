#include "package_choice.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "base/error.hpp"
#include "base/files.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

constexpr std::size_t kMaxNeighbours = 64;  // folders beside the package that are looked into

std::optional<Sha256> manifest_digest(const fs::path& folder) {
  std::error_code error;
  const fs::path file = folder / kManifestFile;
  if (!fs::is_regular_file(fs::symlink_status(file, error)) || error) return std::nullopt;
  try {
    return sha256(read_file(file, kMaxManifestSize));
  } catch (const Error&) {
    return std::nullopt;
  }
}

fs::path resolved(const fs::path& folder) {
  std::error_code error;
  const fs::path path = fs::weakly_canonical(folder, error);
  return error ? fs::absolute(folder, error) : path;
}

void add_neighbours(const fs::path& folder, std::vector<fs::path>& folders) {
  std::error_code error;
  std::vector<fs::path> found;
  for (fs::directory_iterator at(folder.parent_path(), error), end; !error && at != end; at.increment(error)) {
    if (found.size() >= kMaxNeighbours) break;
    if (at->is_directory(error)) found.push_back(at->path());
  }
  std::sort(found.begin(), found.end());
  folders.insert(folders.end(), found.begin(), found.end());
}

// Where this package lies: at its old place first, then where packages are wanted from, then beside both.
std::vector<fs::path> folders_of(const AcceptedPackage& accepted, const fs::path& wanted) {
  std::vector<fs::path> folders{accepted.folder, wanted};
  add_neighbours(accepted.folder, folders);
  add_neighbours(resolved(wanted), folders);
  add_neighbours(fs::absolute(wanted), folders);
  std::vector<fs::path> matching;
  for (const fs::path& folder : folders) {
    if (manifest_digest(folder) != accepted.manifest) continue;
    const fs::path place = resolved(folder);
    if (std::find(matching.begin(), matching.end(), place) == matching.end()) matching.push_back(place);
  }
  return matching;
}

Opening unreadable(const fs::path& package, const std::exception& error) {
  const auto* known = dynamic_cast<const Error*>(&error);
  Opening opening;
  opening.findings.add(
      {.code = "package.unreadable",
       .where = known != nullptr && !known->text().where.empty() ? known->text().where : package.string(),
       .expected = known != nullptr ? known->text().expected : "",
       .found = known == nullptr              ? error.what()
                : known->text().found.empty() ? known->text().what
                                              : known->text().what + ": " + known->text().found,
       .fix = "check the path and the storage medium; it is tried again"});
  return opening;
}

class Chooser {
 public:
  Chooser(const fs::path& wanted, const AcceptanceReading& accepted, std::string_view boot_id,
          const PackageJudges& judges)
      : wanted_(wanted), record_(accepted.record ? &*accepted.record : nullptr), judges_(judges) {
    holds_ = record_ != nullptr && record_->holds(boot_id);
    airborne_ = holds_ && record_->airborne;
    if (!accepted.rejection.empty()) {
      choice_.notice = "what was accepted before cannot be resumed, acceptance.json: " + accepted.rejection;
    }
  }

  PackageChoice choose() {
    decide();
    return std::move(choice_);
  }

 private:
  void decide() {
    const bool other = record_ != nullptr && manifest_digest(wanted_) != record_->current.manifest;
    if (airborne_ || (holds_ && !other)) {
      if (resume(record_->current)) {
        if (!other)
          return note(fmt::format("resumed as accepted at {}; clock and dates are not asked",
                                  to_rfc3339(record_->current.accepted_at)),
                      "");
        return note(
            fmt::format("{} does not hold the package that was accepted for this flight: it is not used. Flying "
                        "with the accepted one in {}",
                        wanted_.string(), choice_.folder.string()),
            "Nadir: package swapped, flying the accepted one");
      }
    }
    const Findings resuming = std::exchange(choice_.rejected, {});
    if (accept(wanted_)) {
      choice_.rejected = resuming;
      if (!airborne_) return;
      return note("the package that was accepted for this flight is not to be found or not whole" + first(resuming) +
                      ": another one was accepted in flight",
                  "Nadir: accepted package lost, flying a new one");
    }
    choice_.rejected.add(resuming);
    if (record_ != nullptr && fall_back(other)) return;
    choice_.opening.findings = std::exchange(choice_.rejected, {});
  }

  bool fall_back(bool other) {
    const std::string why = first(choice_.rejected);
    if (airborne_) {
      if (!record_->previous || !resume(*record_->previous)) return false;
      note("the package that was accepted for this flight cannot be used" + why + ": flying with the one before it, " +
               choice_.folder.string(),
           "Nadir: package damaged, flying the one before");
      return true;
    }
    if (!other) return false;  // the wanted one was the last accepted one
    bool found = holds_ && resume(record_->current);
    if (!found) {
      for (const fs::path& folder : folders_of(record_->current, wanted_)) {
        if ((found = accept(folder))) break;
      }
    }
    if (!found) return false;
    note("the new package was rejected" + why + ": flying with the last accepted one, " + choice_.folder.string(),
         "Nadir: new package rejected, using the last one");
    return true;
  }

  void note(const std::string& notice, std::string text) {
    choice_.notice += (choice_.notice.empty() ? "" : "; ") + notice;
    choice_.notice_text = std::move(text);
  }

  static std::string first(const Findings& findings) {
    for (const Finding& finding : findings.items()) {
      if (finding.severity == Severity::error)
        return fmt::format(" ({}: {}: {})", finding.code, finding.where, finding.found);
    }
    return "";
  }

  bool accept(const fs::path& folder) {
    return use(folder, false, [&] { return judges_.accept(folder); });
  }

  bool resume(const AcceptedPackage& accepted) {
    for (const fs::path& folder : folders_of(accepted, wanted_)) {
      if (use(folder, true, [&] { return judges_.resume(folder, accepted); })) return true;
    }
    return false;
  }

  template <typename Judge>
  bool use(const fs::path& folder, bool resumed, const Judge& judge) {
    Opening opening;
    try {
      opening = judge();
    } catch (const Interrupted&) {
      throw;
    } catch (const UsageError& error) {
      if (!airborne_) throw;
      opening = unreadable(folder, error);
    } catch (const std::exception& error) {
      opening = unreadable(folder, error);
    }
    if (!opening.package) {
      choice_.rejected.add(opening.findings);
      return false;
    }
    choice_.opening = std::move(opening);
    choice_.folder = folder;
    choice_.resumed = resumed;
    return true;
  }

  const fs::path& wanted_;
  const AcceptanceRecord* record_;
  const PackageJudges& judges_;
  bool holds_ = false, airborne_ = false;
  PackageChoice choice_;
};

}  // namespace

PackageChoice choose_package(const fs::path& wanted, const AcceptanceReading& accepted, std::string_view boot_id,
                             const PackageJudges& judges) {
  return Chooser(wanted, accepted, boot_id, judges).choose();
}

AcceptedPackage accepted_package(const fs::path& folder, const Manifest& manifest, UtcTime at,
                                 std::string airframe_file) {
  return {.manifest = sha256_file(folder / kManifestFile),
          .folder = resolved(folder),
          .series = manifest.series,
          .sequence = manifest.sequence,
          .accepted_at = at,
          .airframe_file = std::move(airframe_file)};
}

}  // namespace nadir
