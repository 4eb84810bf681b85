#include "planning/route_profile.hpp"

#include <algorithm>
#include <cmath>

#include "geodesy/region.hpp"

namespace nadir {
namespace {

// What the route states at a share of its leg, in its own frame.
double stated_height_m(const Route& route, std::size_t leg, double share) {
  if (route.heights_m.empty()) return route.agl_m;
  return route.heights_m[leg] + share * (route.heights_m[leg + 1] - route.heights_m[leg]);
}

ProfileSample sample_at(const Mission& mission, std::size_t leg, double share, const HeightOfGround& ground,
                        const std::optional<double>& takeoff_m, const LonLat& place) {
  ProfileSample sample;
  sample.place = place;
  sample.ground_m = ground(place);
  const double stated_m = stated_height_m(mission.route, leg, share);
  const HeightFrame frame = mission.route.heights_m.empty() ? HeightFrame::above_ground : mission.route.height_frame;
  if (frame == HeightFrame::above_ground && sample.ground_m) sample.height_m = *sample.ground_m + stated_m;
  if (frame == HeightFrame::above_takeoff && takeoff_m) sample.height_m = *takeoff_m + stated_m;
  if (frame == HeightFrame::above_sea_level) sample.height_m = stated_m;
  if (frame == HeightFrame::above_ground)
    sample.agl_m = stated_m;
  else if (sample.height_m && sample.ground_m)
    sample.agl_m = *sample.height_m - *sample.ground_m;
  return sample;
}

}  // namespace

RouteProfile profile_of(const Mission& mission, const HeightOfGround& ground, const CameraModel* camera,
                        std::size_t samples) {
  RouteProfile profile;
  const LocalFrame frame = mission_frame(mission);
  const PlanePath path = to_plane(frame, mission.route.points);
  if (path.size() < 2) return profile;
  const std::optional<double> takeoff_m = ground(mission.takeoff);
  const double spacing_m = std::max(1.0, length_m(path) / static_cast<double>(std::max<std::size_t>(samples, 2)));
  double begin_m = 0;
  for (std::size_t leg = 0; leg + 1 < path.size(); ++leg) {
    const double leg_m = distance_m(path[leg], path[leg + 1]);
    const auto parts = static_cast<std::size_t>(std::max(1.0, std::ceil(leg_m / spacing_m)));
    const bool last = leg + 2 == path.size();
    profile.points_m.push_back(begin_m);
    for (std::size_t i = 0; i < parts + (last ? 1 : 0); ++i) {
      const double share = static_cast<double>(i) / static_cast<double>(parts);
      const LonLat place = frame.lonlat_from_plane(path[leg] + share * (path[leg + 1] - path[leg]));
      ProfileSample sample = sample_at(mission, leg, share, ground, takeoff_m, place);
      sample.at_m = begin_m + share * leg_m;
      if (camera != nullptr && sample.agl_m && *sample.agl_m > 0) {
        sample.width_m = *sample.agl_m * camera->width / camera->fx;
        sample.length_m = *sample.agl_m * camera->height / camera->fy;
      }
      profile.samples.push_back(sample);
    }
    begin_m += leg_m;
  }
  profile.points_m.push_back(begin_m);
  return profile;
}

}  // namespace nadir
