// Where on the ground is what a camera shows at a pixel, and how far off can that be?
//
// The ray through the pixel is turned by the gimbal and by the aircraft's attitude, and followed until it meets the
// ground. The bound is the radius that contains the object with 95 % probability: the errors of attitude, gimbal,
// height and ground, propagated to the ground with the ray's derivatives, and the aircraft's position error, along the
// worst direction.
//
// The attitude fits the image only as well as the two are synchronised. In level flight that does not matter; in a bank
// or climb of 5° or more the aircraft turns about its axes, and 50 ms at 20 °/s are another degree.
#pragma once

#include <optional>
#include <string>
#include <variant>

#include "geodesy/angles.hpp"
#include "geodesy/local_frame.hpp"
#include "vision/camera.hpp"
#include "vision/ground_surface.hpp"

namespace nadir {

inline constexpr double kManoeuvreTilt_rad = radians(5);
inline constexpr double kManoeuvreExtraSigma_rad = radians(1);
inline constexpr double kMaxObjectRange_m = 20'000;

// MAVLink's convention: the camera looks ahead at zero; yaw turns it to the right, pitch up (-90°: straight down), roll
// clockwise about its axis.
struct GimbalAngles {
  double yaw_rad = 0, pitch_rad = 0, roll_rad = 0;
  bool from_horizon = false;  // pitch and roll are held against the horizon, not against the airframe
};

struct AircraftPose {
  LonLat place;
  double agl_m = 0;  // above the ground below the aircraft
  Attitude attitude;
  double sigma_m = 0;  // of the place, one axis
};

// One sigma each.
struct ObjectUncertainty {
  double heading_rad = radians(2);
  double tilt_rad = radians(1);  // aircraft and gimbal together, level flight
  double agl_relative = 0.03;
};

struct ObjectPlace {
  LonLat place;
  double error_bound_m = 0;  // 95 %
  double range_m = 0;        // along the ray
  bool manoeuvring = false;  // the bound was widened
};

struct NoObjectPlace {
  std::string type;  // "no-ground", "no-bound"
  std::string reason;
};

// frame, surface: the plane and the ground of the package (or flat ground around the aircraft).
std::variant<ObjectPlace, NoObjectPlace> locate_object(const CameraModel& camera, const Eigen::Vector2d& pixel,
                                                       const GimbalAngles& gimbal, const AircraftPose& pose,
                                                       const ObjectUncertainty& uncertainty, const LocalFrame& frame,
                                                       const GroundSurface& surface);

}  // namespace nadir
