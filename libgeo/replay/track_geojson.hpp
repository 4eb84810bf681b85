// track.geojson (RFC 7946): the track as a line, every estimate as a point with its figures, the truth as a line.
#pragma once

#include <string>
#include <vector>

#include "estimation/estimate.hpp"
#include "replay/truth.hpp"

namespace nadir {

std::string track_geojson(const std::vector<Estimate>& estimates, const std::vector<Estimate>& refined,
                          const Truth& truth);

}  // namespace nadir
