#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "base/files.hpp"
#include "package/verify_parts.hpp"

namespace nadir {
namespace {

// Clocks of two machines differ, and missions are written the day before; more than this is no such thing.
constexpr std::int64_t kClockTolerance_s = 86'400;

void check_clock(const Manifest& manifest, const VerifyOptions& options, Findings& findings) {
  std::optional<UtcTime> earliest;
  std::string because;
  if (options.at.unix_s + kClockTolerance_s < manifest.created.unix_s) {
    earliest = manifest.created;
    because = "when the package was made";
  }
  if (options.state != nullptr && options.state->last_trusted_time) {
    const UtcTime last = *options.state->last_trusted_time;
    if (options.at < last && (!earliest || *earliest < last)) {
      earliest = last;
      because = "when this aircraft last accepted a package";
    }
  }
  if (!earliest) return;
  findings.add({.code = "time.untrusted",
                .where = "the clock",
                .expected = fmt::format("not before {}, {}", to_rfc3339(*earliest), because),
                .found = to_rfc3339(options.at),
                .fix = "set the clock; expiry cannot be judged before that"});
}

void check_root(const TrustRoot& root, const VerifyOptions& options, Findings& findings) {
  if (root.expires <= options.at) {
    findings.add({.code = "key.expired",
                  .where = fmt::format("root version {}", root.version),
                  .expected = "a trust root that is valid at " + to_rfc3339(options.at),
                  .found = "expired " + to_rfc3339(root.expires),
                  .fix = "get the makers' newer root"});
  }
  if (options.state != nullptr && root.version < options.state->root_version) {
    findings.add({.code = "root.rollback",
                  .where = "the trust root",
                  .expected = fmt::format("version {} or later, as seen before", options.state->root_version),
                  .found = fmt::format("version {}", root.version),
                  .fix = "use the newest trust root"});
  }
}

void check_sequence(const Manifest& manifest, const TrustRoot& root, const VerifyOptions& options, Findings& findings) {
  if (options.state == nullptr) return;
  const auto seen = options.state->highest_sequence.find(manifest.series);
  if (seen == options.state->highest_sequence.end() || manifest.sequence >= seen->second) return;
  bool permitted = false;
  if (options.permit != nullptr) {
    const Findings objections = check_permit(
        *options.permit, root, {manifest.series, seen->second, manifest.sequence, options.airframe, options.at});
    findings.add(objections);
    permitted = !objections.refuses();
  }
  findings.add({.code = "package.rollback",
                .severity = permitted ? Severity::warning : Severity::refuse,
                .where = "series " + manifest.series,
                .expected = fmt::format("sequence {} or later, as accepted before", seen->second),
                .found = fmt::format("sequence {}{}", manifest.sequence, permitted ? ", which the permit allows" : ""),
                .fix = permitted ? "" : "use the newest package of this series, or get a rollback permit"});
}

void check_airframe(const Manifest& manifest, const VerifyOptions& options, Findings& findings) {
  if (!options.airframe) return;
  const auto allows = [&](const std::string& name) { return name == kAnyAirframe || name == *options.airframe; };
  if (std::any_of(manifest.airframes.begin(), manifest.airframes.end(), allows)) return;
  findings.add({.code = "airframe.mismatch",
                .where = "manifest.json /airframes",
                .expected = "a package for airframe " + *options.airframe,
                .found = fmt::format("a package for {}", fmt::join(manifest.airframes, ", ")),
                .fix = "load the package that was made for this airframe"});
}

}  // namespace

Findings verify_policy(const Manifest& manifest, const TrustRoot& root, const VerifyOptions& options) {
  Findings findings;
  check_clock(manifest, options, findings);
  check_root(root, options, findings);
  if (manifest.expires <= options.at) {
    findings.add({.code = "package.expired",
                  .where = "manifest.json /expires",
                  .expected = "a package that is valid at " + to_rfc3339(options.at),
                  .found = "expired " + to_rfc3339(manifest.expires),
                  .fix = "build a new package with a later expiry"});
  }
  check_sequence(manifest, root, options, findings);
  check_airframe(manifest, options, findings);
  return findings;
}

void verify_mission(const std::filesystem::path& package, Verification& result) {
  const Manifest& manifest = *result.manifest;
  const auto mismatch = [&result](std::string where, std::string expected, std::string found) {
    result.findings.add({.code = "mission.mismatch",
                         .where = std::move(where),
                         .expected = std::move(expected),
                         .found = std::move(found),
                         .fix = "build the package again from its mission"});
  };
  const Artifact* artifact = manifest.artifact(kRoleMission);
  if (artifact == nullptr) return mismatch("manifest.json", "an artifact of role \"mission\"", "none");
  MissionReading reading =
      parse_mission(read_text_file(package / artifact->path, std::uint64_t{1} << 20), artifact->path);
  if (!reading.mission) {
    return mismatch(reading.findings.items().front().where, reading.findings.items().front().expected,
                    reading.findings.items().front().found);
  }
  const Mission& mission = *reading.mission;
  const auto compare = [&](const char* what, const std::string& in_manifest, const std::string& in_mission) {
    if (in_manifest != in_mission) mismatch(artifact->path + ", " + what, in_manifest, in_mission);
  };
  compare("id", manifest.mission_id, mission.id);
  compare("series", manifest.series, mission.series);
  compare("sequence", std::to_string(manifest.sequence), std::to_string(mission.sequence));
  compare("created", to_rfc3339(manifest.created), to_rfc3339(mission.created));
  compare("expires", to_rfc3339(manifest.expires), to_rfc3339(mission.expires));
  compare("airframes", fmt::format("{}", fmt::join(manifest.airframes, ", ")),
          fmt::format("{}", fmt::join(mission.airframes, ", ")));
  result.mission = std::move(reading.mission);
}

}  // namespace nadir
