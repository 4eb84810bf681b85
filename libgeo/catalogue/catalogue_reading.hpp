// Reads a package for the catalogue: what may go in, and why not where it may not.
#pragma once

#include <filesystem>
#include <optional>

#include "base/error.hpp"
#include "catalogue/catalogue.hpp"
#include "package/verify.hpp"

namespace nadir {

// entry is there exactly when no finding refuses.
struct CatalogueReading {
  Findings findings;
  std::optional<CatalogueEntry> entry;
};

// With options the package is verified with them. Without, its parts must fit each other (the mission and the tiles'
// digests those of the manifest), but nobody vouches for them. Throws Error when there is no package or it cannot be
// read.
CatalogueReading read_catalogue_entry(const std::filesystem::path& package, const VerifyOptions* options,
                                      Progress& progress);

}  // namespace nadir
