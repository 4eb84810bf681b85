// A second map matcher, which shows that the interface is independent of the backend, and compares the channels with it
// (./run bench ablations). The contract of map_matcher.hpp is tested over both.
//
// SIFT features of the rectified frame among those of the map, and the place on which most of them agree by a robust
// homography. For images of one season: across seasons it recognises few places.
#pragma once

#include <memory>

#include "vision/map_matcher.hpp"

namespace nadir {

std::unique_ptr<MapMatcher> make_sift_matcher(const MatcherMap& map);

}  // namespace nadir
