// What a photo says about itself: EXIF and XMP, through exiv2.
//
// Time: EXIF has the camera's wall clock, to the second, with sub-seconds and the offset from UTC where the camera
// writes them (since EXIF 2.31). Newer DJI cameras write the UTC of the exposure. Without any of these a time is local
// time of an unknown zone. camera_s is the wall clock as seconds since 1970, as if it showed UTC.
//
// Attitude: DJI, Parrot and Autel write yaw, pitch and roll of the gimbal in their XMP: of a camera that looks ahead,
// so that -90° of pitch looks at nadir. Others (senseFly, MicaSense, Sequoia) write Camera:Yaw, Pitch, Roll, those of a
// camera that looks down, as of an aircraft.
//
// Position: GPS of a photo is ground truth for scoring, never an input of localization.
//
// The file is walked to its metadata segments, which are at most 64 KiB each, and these alone are given to exiv2;
// pixels are not read. A photo whose metadata are damaged has none, and `problem` says why.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "geodesy/lon_lat.hpp"
#include "imagery/frame_image.hpp"
#include "vision/camera.hpp"

namespace nadir {

struct PhotoFacts {
  std::filesystem::path file;
  FrameSize size;
  std::string problem;  // with its metadata; empty: none

  std::optional<double> camera_s;  // wall clock, seconds since 1970 as if it showed UTC
  double clock_step_s = 1;         // the camera rounds its time down to multiples of this
  std::optional<double> zone_s;    // wall clock less UTC
  std::optional<double> utc_s;     // of the exposure, or of the GPS fix that belongs to it; seconds since 1970
  std::string make, model;
  std::optional<double> focal_mm, focal_35mm;  // 35 mm: of an equal diagonal of 43.27 mm
  std::optional<double> sensor_px_per_mm;      // of the focal plane
  std::optional<double> calibrated_focal_px;   // by the maker
  std::optional<CameraModel> calibration;      // by the maker, with distortion
  std::optional<double> relative_altitude_m;   // above the place of take-off
  std::optional<double> absolute_altitude_m;   // above sea level or the ellipsoid: cameras do not say which
  std::optional<Attitude> gimbal;              // of the camera that looks ahead
  std::optional<Attitude> body;                // of the aircraft, or of a camera that looks down
  bool body_is_camera = false;                 // `body` is the camera's own
  std::optional<double> image_direction_rad;   // of the image's up direction, from true north
  std::optional<LonLat> gps;
};

// Throws Error for a file that is no image.
PhotoFacts read_photo_facts(const std::filesystem::path& path);

// The same of metadata in memory: the TIFF structure of EXIF, and an XMP packet; either may be empty.
PhotoFacts parse_photo_metadata(ByteView exif, ByteView xmp);

// The camera's attitude (image-up is the nose, looking down) of a camera on a gimbal.
Attitude nadir_attitude_from_gimbal(const Attitude& gimbal);

}  // namespace nadir
