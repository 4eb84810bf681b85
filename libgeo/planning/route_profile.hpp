// The ground beneath a planned route, and how high above it the aircraft flies.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "geodesy/lon_lat.hpp"
#include "package/mission.hpp"
#include "vision/camera.hpp"

namespace nadir {

struct ProfileSample {
  double at_m = 0;  // along the route
  LonLat place;
  std::optional<double> ground_m;  // above sea level; none where the elevation model does not know
  std::optional<double> height_m;  // of the aircraft, above sea level
  std::optional<double> agl_m;
  double width_m = 0, length_m = 0;  // of the camera's footprint, across and along; 0 without a camera
};

struct RouteProfile {
  std::vector<ProfileSample> samples;
  std::vector<double> points_m;  // where the route's points lie along it
};

using HeightOfGround = std::function<std::optional<double>(LonLat)>;

// Even samples and the route's points: between the points the stated height changes evenly. Empty for an area alone.
RouteProfile profile_of(const Mission& mission, const HeightOfGround& ground, const CameraModel* camera,
                        std::size_t samples);

}  // namespace nadir
