// Small rasters and missions for the tests of simulated flights.
#pragma once

#include <filesystem>
#include <opencv2/core/mat.hpp>

#include "geodesy/lon_lat.hpp"
#include "simulation/flight.hpp"
#include "simulation/geotiff_writer.hpp"

namespace nadir::test {

inline RasterPlacement test_placement(double gsd_m) { return {32632, 500000 + 12000, 5300000, gsd_m}; }

// Through GDAL and PROJ alone, as an oracle.
LonLat lonlat_at(const RasterPlacement& placement, double column, double row);

void write_picture(const std::filesystem::path& path, const cv::Mat_<cv::Vec3b>& bgr, const RasterPlacement& placement);
void write_camera(const std::filesystem::path& path, int width, int height, double focal_px, bool distorted);
Mission mission_over(const RasterPlacement& placement, const std::vector<cv::Point2d>& route_px, double agl_m);

}  // namespace nadir::test
