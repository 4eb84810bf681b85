// The rasters that a map is made of, as the user names them, with what must be known about each: capture time, ground
// sample distance, provider and accuracy. Earlier ones lie on top of later ones.
//
// The facts come from a STAC Item (stac.hpp), beside the file (`map.tif` + `map.json`) or in a list that names it:
// properties.datetime, gsd, providers[0].name, nadir:ce90_m, license, and attribution (of STAC's extension of this
// name). The user may state them instead.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/digest.hpp"
#include "base/error.hpp"
#include "base/time.hpp"
#include "geodesy/web_mercator.hpp"
#include "package/manifest.hpp"
#include "package/sidecar.hpp"
#include "raster/stac.hpp"
#include "raster/stretch.hpp"

namespace nadir {

struct ImageryFacts {
  UtcTime captured_at;
  double gsd_m = 0;   // ground sample distance
  double ce90_m = 0;  // circular error: 90 % of well-defined points lie within this distance of their true position
  std::string provider;
  std::string licence{};      // an SPDX identifier, a name, or "unknown"; empty: not stated
  std::string attribution{};  // what the licence asks to be shown; empty: nothing is stated
};

// What the user states instead of the item.
struct ImageryOverrides {
  std::optional<UtcTime> captured_at;
  std::optional<double> gsd_m;
  std::optional<double> ce90_m;
  std::optional<std::string> provider;
  std::optional<std::string> licence{};
  std::optional<std::string> attribution{};
};

// Throws UsageError when a fact is neither in the item nor stated: freshness and accuracy could not be evaluated.
ImageryFacts read_imagery_facts(const StacItem& item, const ImageryOverrides& overrides);
ImageryFacts read_imagery_facts(const std::filesystem::path& raster, const ImageryOverrides& overrides);

struct ImageryInput {
  std::filesystem::path path;  // of a file, or the URL of a mounted object (pinned_files.hpp)
  ImageryFacts facts;
  std::vector<MercatorXY> outline;  // RasterSource::outline()
  TileTrust trust = TileTrust::service;
  std::optional<Stretch> stretch{};       // of a raster that is not 8 bit
  double place_precision_m = 0;           // RasterSource::place_precision_m()
  std::optional<Sha256> stated_sha256{};  // of the raster's file, by a list that names it
  double pixel_m = 0;                     // side of a pixel on the ground, as the file is georeferenced; 0: not known
};

// "resolution.implausible": a stated ground sample distance that is much finer than the raster's pixels.
Findings check_stated_resolution(std::span<const ImageryInput> inputs);

// "imagery.coarse_place": a stated accuracy that is better than the precision with which the file states its place.
Findings check_stated_places(std::span<const ImageryInput> inputs);

// "licence.unstated", a warning: imagery of which nobody said under which licence it is. "unknown" is an answer too.
Findings check_stated_licences(std::span<const ImageryInput> inputs);

// The sources that these tiles name, with what the inputs and `known` (of an older package) state of them; those of
// which nothing is stated are left out. Sorted, each once.
std::vector<SourceLicence> stated_sources(std::span<const Sidecar> tiles, std::span<const ImageryInput> inputs,
                                          std::span<const SourceLicence> known = {});

// What an option names: a raster with the item beside it, or, for a list (stac.hpp), its rasters, whose pinned objects
// are mounted. Throws UsageError for what is remote and not pinned.
std::vector<StacAsset> named_rasters(const std::filesystem::path& named);

// The rasters that the paths name, in their order. stretches: none, one for all, or one for each path. Throws Error for
// a raster that does not open, UsageError when a fact or a stretch is missing. The stretch is appended to the provider,
// which every tile names as its source: "survey (112 to 9873)".
std::vector<ImageryInput> open_imagery(std::span<const std::filesystem::path> paths, const ImageryOverrides& overrides,
                                       std::span<const StretchRequest> stretches);

// Which inputs contributed to a tile, and how many pixels of the finest zoom each.
using InputShares = std::map<std::size_t, std::uint64_t>;

// A tile of several inputs takes the oldest capture time, the coarsest resolution, the worst accuracy and the lowest
// trust of them. Its source names each provider once, the one with the largest share first.
void set_facts(Sidecar& sidecar, std::span<const ImageryInput> inputs, const InputShares& used);

}  // namespace nadir
