// Validates any MBTiles or COG against a mission: no signature, no sidecars needed. Every tile is decoded; what is
// missing is reported by place and area.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "base/error.hpp"
#include "base/progress.hpp"
#include "base/time.hpp"
#include "package/mission.hpp"
#include "package/sidecar.hpp"

namespace nadir {

struct Validation {
  // sqlite.corrupt tiff.corrupt tiff.grid tiff.layout tile.undecodable tile.size tile.blank tile.misaddressed
  // coverage.gap budget.exceeded; for files with sidecars also artifact.hash freshness.stale resolution.coarse
  Findings findings;
  std::uint64_t tiles = 0;
  std::uint64_t bytes = 0;  // of the file
  bool has_sidecars = false;
  // What was validated, in the order of TileKey. Without sidecars in the file: address, valid share and mask as
  // decoded, captured_at is the time of validation.
  std::vector<Sidecar> sidecars;
};

// Throws Error when the file is missing or is neither a database with tiles nor a TIFF. A TIFF that is no tile set is a
// finding.
Validation validate_tile_set(const std::filesystem::path& tiles, const Mission& mission, UtcTime at,
                             Progress& progress);

}  // namespace nadir
