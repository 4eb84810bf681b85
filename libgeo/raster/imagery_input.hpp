// The rasters that a map is made of. Earlier ones lie on top of later ones.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <vector>

#include "geodesy/web_mercator.hpp"
#include "raster/imagery_facts.hpp"
#include "raster/stretch.hpp"
#include "package/sidecar.hpp"

namespace nadir {

struct ImageryInput {
  std::filesystem::path path;
  ImageryFacts facts;
  std::vector<MercatorXY> outline;  // RasterSource::outline()
  TileTrust trust = TileTrust::service;
  std::optional<Stretch> stretch{};  // of a raster that is not 8 bit
};

// Which inputs contributed to a tile, and how many pixels of the finest zoom each.
using InputShares = std::map<std::size_t, std::uint64_t>;

// A tile of several inputs is as old as the oldest, as coarse as the coarsest, as badly placed and as little trusted as
// the worst. Its source names them all once, the one with the largest share first.
void set_facts(Sidecar& sidecar, std::span<const ImageryInput> inputs, const InputShares& used);

}  // namespace nadir
