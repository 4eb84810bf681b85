// Where a raster lies and how large it is, before anything of it is read.
#pragma once

#include <filesystem>
#include <opencv2/core/types.hpp>

#include "geodesy/local_frame.hpp"
#include "geodesy/region.hpp"

namespace nadir {

struct WorldExtent {
  LonLat centre;
  cv::Size size;     // pixels
  double gsd_m = 0;  // of its pixels at the centre: the geometric mean of both directions
  PlaneBox box;      // around all of it, in metres from the centre
};

// Throws Error or UsageError for what is missing, no raster, or without georeference.
WorldExtent extent_of_world(const std::filesystem::path& path);

}  // namespace nadir
