// Routes and areas as people draw them in other programs: KML, GeoJSON, or any other vector file that GDAL reads.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "geodesy/lon_lat.hpp"

namespace nadir {

struct DrawnShape {
  std::string name;  // the feature's, may be empty
  std::vector<LonLat> points;
};

struct DrawnPlan {
  std::vector<DrawnShape> lines;
  std::vector<DrawnShape> areas;  // outer rings, closed: the last point repeats the first
};

// Heights are dropped, multi-geometries taken apart, other kinds of geometry passed over. Throws Error for a file that
// cannot be read or does not say where on the Earth it lies, UsageError for an area with holes.
DrawnPlan read_drawn_plan(const std::filesystem::path& path);

}  // namespace nadir
