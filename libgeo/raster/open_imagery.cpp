#include "raster/open_imagery.hpp"

#include <fmt/format.h>

#include "base/error.hpp"
#include "raster/raster_source.hpp"
#include "raster/stretch_sample.hpp"

namespace nadir {

std::vector<ImageryInput> open_imagery(std::span<const std::filesystem::path> paths, const ImageryOverrides& overrides,
                                       std::span<const StretchWish> stretches) {
  if (stretches.size() > 1 && stretches.size() != paths.size()) {
    throw UsageError({.what = "the stretches do not go with the rasters",
                      .where = "--stretch",
                      .expected = fmt::format("one for all, or {}: one for each --imagery", paths.size()),
                      .found = std::to_string(stretches.size()),
                      .fix = "write --stretch none for a raster that is 8 bit"});
  }
  std::vector<ImageryInput> inputs;
  for (std::size_t i = 0; i < paths.size(); ++i) {
    const StretchWish wish = stretches.empty() ? StretchWish{} : stretches[stretches.size() == 1 ? 0 : i];
    const std::optional<Stretch> stretch = settle_stretch(paths[i], wish);
    const RasterSource source(paths[i], stretch);
    ImageryInput input{paths[i], read_imagery_facts(paths[i], overrides), source.outline()};
    input.stretch = stretch;
    if (stretch) input.facts.provider += fmt::format(" ({})", to_text(*stretch));
    inputs.push_back(std::move(input));
  }
  return inputs;
}

}  // namespace nadir
