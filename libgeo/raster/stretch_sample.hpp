// The values of a raster that is not 8 bit, looked at in a sample that is the same every time: all pixels of a small
// raster, else small windows spread evenly over it.
#pragma once

#include <filesystem>
#include <optional>

#include "raster/stretch.hpp"

namespace nadir {

// What the wish comes to for this raster; nothing for a raster that is 8 bit, which keeps its values. Percentiles are
// of the valid pixels of all colour bands together, between neighbours in proportion (percentile 0 is the least value,
// 100 the greatest). Throws UsageError, with the range of its values, for a raster that needs a stretch and has none.
std::optional<Stretch> settle_stretch(const std::filesystem::path& raster, const StretchWish& wish);

}  // namespace nadir
