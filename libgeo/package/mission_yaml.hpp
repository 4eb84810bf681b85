// A mission as its file: what parse_mission() reads back as the same mission, to the last bit of every number.
#pragma once

#include <set>
#include <string>

#include "package/mission.hpp"

namespace nadir {

// to_check: keys whose values were assumed ("expires", "class", "agl_m"); their lines end with "# check".
std::string mission_yaml(const Mission& mission, const std::set<std::string>& to_check = {});

}  // namespace nadir
