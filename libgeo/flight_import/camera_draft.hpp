// A first camera.yaml of photos that say what took them. In the order of trust:
//
//   1. the maker's calibration in the photo (DJI's DewarpData): focal length, principal point, distortion
//   2. the maker's calibrated focal length in pixels
//   3. focal length in mm and width of the sensor: stated by the user, or of the table of cameras
//   4. focal length in mm and pixels per mm of the focal plane, in EXIF
//   5. the focal length for 35 mm film, by the sensors' diagonals (rounded to a millimetre: 2 to 4 % off)
//
//   fx = focal length / width of the sensor · longer side of the image          (square pixels)
//
// A draft is good to some percent. `nadir provision camera` calibrates.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "flight_import/photo_metadata.hpp"
#include "vision/camera.hpp"

namespace nadir {

// Width of the sensor, the side that the longer side of the image lies along; by the names that EXIF has. Case and
// the maker's name in front of the model's do not matter.
std::optional<double> known_sensor_width_mm(std::string_view make, std::string_view model);

struct StatedLens {
  std::optional<double> focal_px{}, focal_mm{}, sensor_width_mm{};  // by the user, who knows better than the photo
};

struct CameraDraft {
  CameraModel camera;
  std::string from;  // where the focal length comes from, for people
  // The focal length for 35 mm film disagrees with it by this factor, where that is more than 15 %.
  std::optional<double> disagreement;
};

// Nothing when the focal length is not known.
std::optional<CameraDraft> draft_camera(const PhotoFacts& photo, const StatedLens& stated);

// camera.yaml with comments that say where the numbers come from.
std::string draft_yaml(const CameraDraft& draft, const TelemetryUncertainty& uncertainty, std::string_view taken_with);

}  // namespace nadir
