// What must be known about a raster before it may become a map: when it was taken, how fine it is, by whom, and how
// well it is placed. Read from the STAC Item beside the file (`map.tif` + `map.json`, stacspec.org 1.0):
// properties.datetime, gsd, providers[0].name and nadir:ce90_m.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "base/time.hpp"

namespace nadir {

struct ImageryFacts {
  UtcTime captured_at;
  double gsd_m = 0;   // ground sample distance
  double ce90_m = 0;  // 90 % of well-defined points lie within this of their true place
  std::string provider;
};

// What the user states instead of the item.
struct ImageryOverrides {
  std::optional<UtcTime> captured_at;
  std::optional<double> gsd_m;
  std::optional<double> ce90_m;
  std::optional<std::string> provider;
};

// Throws UsageError when a fact is neither in the item nor stated: without it freshness or accuracy cannot be judged.
ImageryFacts read_imagery_facts(const std::filesystem::path& raster, const ImageryOverrides& overrides);

std::filesystem::path stac_item_beside(const std::filesystem::path& raster);

}  // namespace nadir
