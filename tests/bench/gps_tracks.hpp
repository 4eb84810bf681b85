// Flights for the judge of the aircraft's GPS (runtime/service/gps_health.hpp): where the aircraft was, and where
// vision said it was. Drawn flights are made without pictures in milliseconds, and err as much as the flight filter
// claims; flown ones are made by the localizer over worlds in memory.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "safety_world.hpp"

namespace nadir::bench {

struct TrackPoint {
  double time_s = 0;
  Eigen::Vector2d truth_m = Eigen::Vector2d::Zero();     // east, north
  Eigen::Vector2d estimate_m = Eigen::Vector2d::Zero();  // of vision
  Eigen::Vector2d velocity_mps = Eigen::Vector2d::Zero();
  double sigma_m = 0;   // one axis, as claimed; negative: no position
  bool visual = false;  // satellite_anchored or vo_extrapolated
};

struct Track {
  std::uint64_t index = 0;
  std::vector<TrackPoint> points;
};

std::string line(const Track& track);
Track track_of(const std::string& line);  // throws Error when it is none

// Two frames a second. Every fourth flight is matched with the map every 20 s only, every fourth goes blind for 10 s
// each minute.
Track draw_track(std::uint64_t base_seed, std::uint64_t index, int frames);
Track fly_track(std::uint64_t base_seed, std::uint64_t index, int frames, const World& world);

}  // namespace nadir::bench
