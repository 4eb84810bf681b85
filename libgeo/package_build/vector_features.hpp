// Routes and areas drawn in other programs: KML, GeoJSON, or any other vector file that GDAL reads.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "geodesy/lon_lat.hpp"

namespace nadir {

struct VectorFeature {
  std::string name;  // of the feature, may be empty
  std::vector<LonLat> points;
};

struct VectorFeatures {
  std::vector<VectorFeature> lines;
  std::vector<VectorFeature> areas;  // outer rings, closed: the last point repeats the first
};

// In longitude and latitude (WGS 84). Heights are dropped, multi-geometries split, other kinds of geometry ignored.
// Throws Error for a file that cannot be read or has no coordinate reference system, UsageError for an area with holes.
VectorFeatures read_vector_features(const std::filesystem::path& path);

}  // namespace nadir
