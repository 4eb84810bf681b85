// A second map matcher, which shows that the interface names no backend, and what the channels are worth beside it
// (./run bench ablations). The contract of map_matcher.hpp is tested over both.
//
// SIFT features of the rectified frame among those of the map, and the place that a robust homography finds most of them
// to agree on. For images of one season: across seasons it recognises few places.
#pragma once

#include <memory>

#include "vision/map_matcher.hpp"

namespace nadir {

std::unique_ptr<MapMatcher> make_sift_matcher(const MatcherMap& map);

}  // namespace nadir
