// Where the aircraft really was, for scoring after the fact. Nothing here reaches the localizer.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "estimation/telemetry.hpp"
#include "geodesy/lon_lat.hpp"

namespace nadir {

using Truth = std::vector<std::optional<LonLat>>;  // one per frame of the flight; nothing where none is known

// truth.csv: frame,lat_deg,lon_deg[,alt_m]. Throws UsageError for frames that the flight does not have or that come
// twice, and for positions that cannot be.
Truth read_truth(const std::filesystem::path& path, const std::vector<Telemetry>& frames);

}  // namespace nadir
