#include "package_build/update_old_package.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "base/sha256.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

// Findings that say no more than that a package may not fly.
constexpr std::array<std::string_view, 9> kOfNoConcern = {"package.expired",   "time.untrusted",    "freshness.stale",
                                                          "coverage.gap",      "resolution.coarse", "budget.exceeded",
                                                          "airframe.mismatch", "dem.gap",           "dem.implausible"};

}  // namespace

OldPackage read_old_package(const fs::path& package, const TrustRoot& trusted, UtcTime at, Progress& progress) {
  const Verification verification = verify_package(package,
                                                   {.root = &trusted,
                                                    .depth = VerifyDepth::quick,
                                                    .at = at,
                                                    .airframe = std::nullopt,
                                                    .state = nullptr,
                                                    .permit = nullptr},
                                                   progress);
  OldPackage old;
  for (Finding finding : verification.findings.items()) {
    if (std::find(kOfNoConcern.begin(), kOfNoConcern.end(), finding.code) != kOfNoConcern.end()) continue;
    finding.where = fmt::format("{}: {}", package.string(), finding.where);
    old.findings.add(std::move(finding));
  }
  old.manifest = verification.manifest;
  old.tiles = verification.tiles;
  old.newest_root = walk_package_roots(package, trusted, nullptr).root;
  old.roots = roots_in_package(package);
  return old;
}

Findings judge_succession(const Manifest& old, const Mission& mission, const fs::path& mission_file) {
  Findings findings;
  if (old.series != mission.series) {
    findings.add({.code = "mission.mismatch",
                  .where = mission_file.string() + " (series)",
                  .expected = fmt::format("{}, that of the package", old.series),
                  .found = mission.series,
                  .fix = "build the first package of a series with `nadir cache build`"});
  } else if (mission.sequence <= old.sequence) {
    findings.add({.code = "package.rollback",
                  .where = mission_file.string() + " (sequence)",
                  .expected = fmt::format("{} or more, because the package has {}", old.sequence + 1, old.sequence),
                  .found = std::to_string(mission.sequence),
                  .fix = "give the mission the next sequence: aircraft refuse a lower one"});
  }
  const Artifact* imagery = old.artifact(kRoleImagery);
  if (imagery == nullptr || !imagery->tiles) return findings;
  const ZoomRange zoom = imagery->tiles->zoom;
  if (zoom.min != mission.zoom.min || zoom.max != mission.zoom.max) {
    findings.add({.code = "mission.mismatch",
                  .where = mission_file.string() + " (zoom)",
                  .expected = fmt::format("{} to {}, those of the package", zoom.min, zoom.max),
                  .found = fmt::format("{} to {}", mission.zoom.min, mission.zoom.max),
                  .fix = "other zooms need every tile anew: `nadir cache build`"});
  }
  return findings;
}

std::optional<fs::path> old_terrain(const fs::path& package, const Manifest& manifest, Findings& findings) {
  const Artifact* terrain = manifest.artifact(kRoleTerrain);
  if (terrain == nullptr) return std::nullopt;
  if (sha256_file(package / terrain->path) == terrain->sha256) return package / terrain->path;
  findings.add({.code = "artifact.hash",
                .where = fmt::format("{}: {}", package.string(), terrain->path),
                .expected = terrain->sha256.hex(),
                .found = "other bytes",
                .fix = "get the package again from its makers, or give an elevation model with --dem"});
  return std::nullopt;
}

}  // namespace nadir
