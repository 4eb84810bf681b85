// Does an elevation model hold what the mission needs? The builder asks before it writes one, verification and the
// aircraft ask about the one that lies in a package. Same rules for all.
#pragma once

#include <filesystem>
#include <optional>

#include "base/error.hpp"
#include "imagery/terrain_raster.hpp"
#include "package/manifest.hpp"
#include "package/mission.hpp"

namespace nadir {

// "dem.gap": parts of the sectors or of the corridor without a height. "dem.implausible": heights that no ground has.
Findings judge_terrain(const Mission& mission, const TerrainRaster& terrain);

// The terrain file of a package whose manifest has been verified: present as the mission says, with the bytes that were
// signed ("artifact.hash"), readable ("dem.corrupt"), and fit for the mission.
struct TerrainReading {
  Findings findings;
  std::optional<TerrainRaster> terrain;  // with mode dem, when nothing refuses
};
TerrainReading read_package_terrain(const std::filesystem::path& package, const Manifest& manifest,
                                    const Mission& mission);

// What shows without reading it: "dem.gap" where mode dem has no terrain file, "mission.mismatch" where mode flat has
// one.
Findings judge_terrain_presence(const Manifest& manifest, const Mission& mission);

}  // namespace nadir
