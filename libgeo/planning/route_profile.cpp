#include "planning/route_profile.hpp"

#include <algorithm>
#include <cmath>

#include "geodesy/region.hpp"

namespace nadir {
namespace {

// What a height that the route states at a point is above the ground of another place.
std::optional<double> above_ground_m(double height_m, HeightFrame frame, const std::optional<double>& ground_m,
                                     const std::optional<double>& takeoff_m) {
  if (frame == HeightFrame::above_ground) return height_m;
  if (!ground_m || (frame == HeightFrame::above_takeoff && !takeoff_m)) return std::nullopt;
  return height_m - *ground_m + (frame == HeightFrame::above_takeoff ? *takeoff_m : 0);
}

ProfileSample sample_at(const Mission& mission, std::size_t leg, double share, const HeightOfGround& ground,
                        const std::optional<double>& takeoff_m, const LonLat& place) {
  ProfileSample sample;
  sample.place = place;
  sample.ground_m = ground(place);
  const Route& route = mission.route;
  if (route.heights_m.empty()) {
    sample.agl_m = route.agl_m;
  } else {
    const auto from = above_ground_m(route.heights_m[leg], route.frame_at(leg), sample.ground_m, takeoff_m);
    const auto to = above_ground_m(route.heights_m[leg + 1], route.frame_at(leg + 1), sample.ground_m, takeoff_m);
    if (from && to) sample.agl_m = *from + share * (*to - *from);
    // Above sea level even where the ground is not known.
    const auto absolute = [&](std::size_t point) -> std::optional<double> {
      if (route.frame_at(point) == HeightFrame::above_sea_level) return route.heights_m[point];
      if (route.frame_at(point) == HeightFrame::above_takeoff && takeoff_m) return route.heights_m[point] + *takeoff_m;
      return std::nullopt;
    };
    const auto begin_m = absolute(leg), end_m = absolute(leg + 1);
    if (begin_m && end_m) sample.height_m = *begin_m + share * (*end_m - *begin_m);
  }
  if (!sample.height_m && sample.agl_m && sample.ground_m) sample.height_m = *sample.ground_m + *sample.agl_m;
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
