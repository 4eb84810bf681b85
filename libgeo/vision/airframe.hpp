// What an aircraft is to us: its camera, how that is mounted, and who it is on the link. airframe.json
// (docs/formats/airframe.md), written by whoever provisions the aircraft.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include "vision/camera_model.hpp"

namespace nadir {

struct Airframe {
  std::string id;
  CameraFile camera;
  // The camera's attitude in the aircraft: yaw of image-up against the nose, clockwise seen from above, then pitch and
  // roll as of an aircraft. Zeros: looks straight down, image-up to the nose.
  Attitude mount;
  double capture_delay_s = 0;    // from the exposure to the moment when the picture is handed over
  std::uint8_t system = 1;       // MAVLink's number of the aircraft
  std::uint8_t autopilot = 1;    // component that is the autopilot
  std::uint8_t component = 197;  // ours; MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY
  std::uint8_t link = 1;         // our link id in signatures
  std::uint8_t gps_id = 0;       // of GPS_INPUT
};

// Throw UsageError with file, line and column.
Airframe read_airframe(const std::filesystem::path& path);
Airframe parse_airframe(std::string_view text, std::string_view name);

// Where the camera looks when the aircraft has this attitude.
Attitude camera_attitude(const Attitude& aircraft, const Attitude& mount);
// The other way round: the attitude of the aircraft whose camera looks so.
Attitude aircraft_attitude(const Attitude& camera, const Attitude& mount);

}  // namespace nadir
