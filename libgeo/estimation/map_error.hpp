// What no number of anchors averages out: the map's own error, which all anchors of a map share, and what no model has.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "vision/map_matcher.hpp"

namespace nadir {

class CheckedTiles;

// 1-σ error per axis of a circular error given as CE90: CE90 / √(-2 ln(1 - 0.9)).
double map_sigma_from_ce90(double ce90_m);
// The same from the worst CE90 that a package's tiles state: for what is measured over all of the map at once.
double map_sigma_m(const CheckedTiles& tiles);
// Of the tiles that a match was found on: what they state, unless the configuration sets it.
double map_sigma_of(const AnchorMatch& match, const std::optional<double>& configured_m);

// Variance of one axis of what no model has (lens, relief, the moment of the telemetry); it grows with height.
double unmodelled_variance_m2(double agl_m);

// Both together, of a position that is anchored to such a map.
Eigen::Matrix2d shared_error_m2(double map_sigma_m, double agl_m);

}  // namespace nadir
