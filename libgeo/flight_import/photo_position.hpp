// Positions written into photos, as EXIF's GPS tags: what GIS and photogrammetry read.
//
// GPSLatitude, GPSLongitude and their references, to 1e-4 of a second (3 mm); GPSMapDatum "WGS-84";
// GPSHPositioningError, the radius in metres that holds 68 % of errors; GPSProcessingMethod "MANUAL", EXIF's word for
// what no receiver measured. Whatever else the photo says stays: its time, its altitude, its XMP.
#pragma once

#include <filesystem>

#include "geodesy/lon_lat.hpp"

namespace nadir {

struct PhotoPosition {
  LonLat place;
  double sigma_m = 0;  // one axis
};

// Radius of a circle that holds 68 % of a circular Gaussian with this σ per axis.
double radius_68_m(double sigma_m);

// Changes the file: give it a copy. JPEG, PNG or TIFF. Throws Error for what is none, or cannot be written.
void write_photo_position(const std::filesystem::path& copy, const PhotoPosition& position);

}  // namespace nadir
