// Position and attitude of the simulated aircraft over time: the route with rounded turns, coordinated banks,
// wind, and the small motions of a light airframe.
#pragma once

#include <cstdint>
#include <vector>

#include "geodesy/region.hpp"
#include "simulation/noise.hpp"
#include "simulation/world_raster.hpp"
#include "vision/camera.hpp"

namespace nadir {

struct FlightPose {
  double time_s = 0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // of the camera, in the flight's frame
  Attitude attitude;
  double agl_m = 0;                                        // above the ground straight below
  double pressure_agl_m = 0;                               // above a smoothed terrain, as a barometer measures it
  Eigen::Vector2d velocity_mps = Eigen::Vector2d::Zero();  // over ground
};

struct FlightPathOptions {
  double agl_m = 100;
  double speed_mps = 22;
  double interval_s = 1;
  int max_frames = 400;
  bool calm = false;  // no attitude motion and no wind: for exact experiments
};

// The same flight at any moment: what a rolling shutter sees between two frames.
class FlightPath {
 public:
  // ground: must outlive the path.
  FlightPath(const PlanePath& route, const GroundShape& ground, const FlightPathOptions& options, std::uint64_t seed);

  double length_m() const { return arc_.empty() ? 0 : arc_.back(); }  // 0: there is no route
  // Of a path that has a length.
  FlightPose at(double time_s) const;

 private:
  FlightPathOptions options_;
  const GroundShape& ground_;
  PlanePath line_;
  std::vector<double> arc_, course_, curvature_, smooth_terrain_;
  double crab_ = 0;
  Noise sway_, quick_, climb_;
};

// The poses of its frames.
std::vector<FlightPose> simulate_flight_path(const PlanePath& route, const GroundShape& ground,
                                             const FlightPathOptions& options, std::uint64_t seed);

}  // namespace nadir
