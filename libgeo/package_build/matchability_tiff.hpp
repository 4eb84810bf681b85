// A matchability map as a GeoTIFF in EPSG:3857 (docs/formats/matchability.md), for QGIS and planning tools.
#pragma once

#include <filesystem>
#include <string_view>

#include "package_build/matchability_survey.hpp"

namespace nadir {

inline constexpr float kMatchabilityNodata = -1;

// Name inside a package that has one, and the artifact's role in its manifest.
inline constexpr std::string_view kMatchabilityFile = "matchability/matchability.tif";
inline constexpr std::string_view kRoleMatchability = "matchability";

// Bands, float32: ratio, entropy, texture, class (1 good, 2 weak, 3 poor), score, valid; kMatchabilityNodata outside of
// the sectors and the corridor. Replaces the file in one step. The same map gives the same bytes.
void write_matchability_tiff(const MatchabilityMap& map, const std::filesystem::path& path);

}  // namespace nadir
