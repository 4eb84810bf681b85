// Do a tile set and an elevation model meet the mission's requirements? The builder asks before it puts a package into
// place, verification asks about signed packages, `nadir cache validate` about any tile set. The rules are the same.
//
// Coverage is checked by area: every pixel centre of the mission's region, at the finest zoom, must lie on a valid
// pixel of a tile that is present. A tile is needed at zoom z exactly when one of its pixel centres lies in the region.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <vector>

#include "base/error.hpp"
#include "base/input_file.hpp"
#include "base/time.hpp"
#include "imagery/terrain_raster.hpp"
#include "package/coverage_requirement.hpp"
#include "package/manifest.hpp"
#include "package/mission.hpp"
#include "package/sidecar.hpp"

namespace nadir {

// "coverage.gap", one finding per zoom with holes and one per hole up to a limit. Tiles sorted by key.
Findings check_coverage(const Mission& mission, std::span<const Sidecar> tiles);

// "freshness.stale": tiles that the region touches and that are older at `at` than their sector allows. Where sectors
// overlap, the strictest governs; the corridor outside of every sector counts as active.
Findings check_freshness(const Mission& mission, std::span<const Sidecar> tiles, UtcTime at);

// "resolution.coarse": tiles of the finest zoom made from imagery coarser than min_resolution_m.
Findings check_resolution(const Mission& mission, std::span<const Sidecar> tiles);

// "budget.exceeded": budget_mb is in units of 10^6 bytes, for the whole package.
// expected_bytes: of a build that was given up; package_bytes is then the least that it would have.
Findings check_budget(const Mission& mission, std::uint64_t package_bytes,
                      std::optional<std::uint64_t> expected_bytes = {});

// "package.expired": aircraft would reject the package at that time. An error for a build that is evaluated as of then,
// a warning for planners whose clock says so.
Findings check_expiry(const Mission& mission, UtcTime at, Severity severity = Severity::error);

// "mission.height", a note: heights that are usual in feet and unusual in metres. "mission.no_fly", a warning: the
// route enters a no-fly area.
Findings check_plausibility(const Mission& mission);

// All four.
Findings check_tile_requirements(const Mission& mission, std::span<const Sidecar> tiles, std::uint64_t package_bytes,
                                 UtcTime at);

// The sector that governs the freshness of this tile, null outside of all.
const Sector* governing_sector(const Mission& mission, const LocalFrame& frame, const TileKey& key);

// "dem.gap": parts of the sectors or of the corridor without a height. "dem.implausible": heights that are not on
// Earth.
Findings check_terrain(const Mission& mission, const TerrainRaster& terrain);

// The terrain file of a package whose manifest has been verified: present as the mission requires, with the bytes that
// were signed ("artifact.hash"), readable ("dem.corrupt"), and fit for the mission.
struct TerrainReading {
  Findings findings;
  std::optional<TerrainRaster> terrain;  // with mode dem, when nothing refuses
};
TerrainReading read_package_terrain(const Directory& package, const Manifest& manifest, const Mission& mission);

// What the manifest alone shows: "dem.gap" where mode dem has no terrain file, "mission.mismatch" where mode flat has
// one.
Findings check_terrain_presence(const Manifest& manifest, const Mission& mission);

}  // namespace nadir
