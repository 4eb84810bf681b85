// The rasters that a map is made of, as the user names them: looked at, with their facts and their stretch.
#pragma once

#include <filesystem>
#include <span>
#include <vector>

#include "raster/imagery_input.hpp"

namespace nadir {

// In the given order. stretches: none, one for all, or one for each. Throws Error for a raster that does not open,
// UsageError when a fact or a stretch is missing. A raster that is stretched says so in its provider, which every tile
// of it names as its source: "survey (112 to 9873)".
std::vector<ImageryInput> open_imagery(std::span<const std::filesystem::path> paths, const ImageryOverrides& overrides,
                                       std::span<const StretchWish> stretches);

}  // namespace nadir
