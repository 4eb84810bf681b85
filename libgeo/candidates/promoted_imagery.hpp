// Promoted tiles as imagery for the next map: Cloud Optimized GeoTIFFs in Web Mercator, transparent where nothing is
// promoted, each with a STAC Item beside it. `nadir cache build --imagery` takes them as they are.
//
// A file holds tiles of one zoom, one day and one block of kBlockTiles² addresses, so that its capture time, resolution
// and accuracy say something: those of its oldest, coarsest and worst placed tile.
#pragma once

#include <filesystem>
#include <vector>

#include "base/progress.hpp"
#include "candidates/catalogue_rows.hpp"
#include "candidates/pack_store.hpp"

namespace nadir {

inline constexpr int kBlockTiles = 16;

struct ExportedImage {
  std::filesystem::path file{};
  std::size_t tiles = 0;
  UtcTime captured_at;
  double gsd_m = 0;
  double ce90_m = 0;
};

// Into a folder that is there. The same tiles give the same files. Throws Error.
std::vector<ExportedImage> write_promoted(std::vector<PromotedTile> tiles, const PackStore& packs,
                                          const std::filesystem::path& folder, Progress& progress);

}  // namespace nadir
