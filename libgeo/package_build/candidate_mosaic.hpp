// A flight's candidate tiles as one image for viewing: a Cloud Optimized GeoTIFF in EPSG:3857, pixel for pixel the
// tiles, transparent where there is none. A large flight is written at a coarser zoom.
#pragma once

#include <cstdint>
#include <filesystem>

#include "base/progress.hpp"

namespace nadir {

struct CandidateMosaic {
  int zoom = 0;
  int width = 0, height = 0;  // pixels
  std::uint64_t tiles = 0;
};

inline constexpr std::int64_t kMaxMosaicPixels = 120'000'000;

// folder: of the candidates. Replaces the file atomically; the same tiles give the same bytes. Throws Error when there
// is no tile, or GDAL cannot write it.
CandidateMosaic write_candidate_mosaic(const std::filesystem::path& folder, const std::filesystem::path& path,
                                       Progress& progress, std::int64_t max_pixels = kMaxMosaicPixels);

}  // namespace nadir
