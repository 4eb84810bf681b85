// An adjusted flight as files that other photogrammetry programs begin with.
//
//   cameras.txt, images.txt, points3D.txt   a COLMAP model (colmap.github.io/format.html)
//   geo.txt                                 of OpenDroneMap: a picture, longitude, latitude, height
//
// COLMAP's world is the map's plane here: x east, y north, z up in metres, from the plane's origin. Its pixels have the
// centre of the top-left one at (0.5, 0.5). All is of the pictures in their full size. The focal length and the
// distortion are the adjusted ones. Frames without an adjusted position are left out.
#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "flight_adjustment/flight_adjustment.hpp"

namespace nadir {

// By name. camera: of the pictures in their full size.
std::map<std::string, std::string> reconstruction_files(const AdjustedFlight& adjusted, const CameraModel& camera);

// A ZIP archive of them (APPNOTE.TXT 6.3, method 0: stored).
std::string zip_archive(const std::map<std::string, std::string>& files);

}  // namespace nadir
