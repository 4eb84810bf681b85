#include "simulation/test_world.hpp"

#include <fmt/format.h>
#include <ogr_spatialref.h>

#include "base/files.hpp"

namespace nadir::test {

LonLat lonlat_at(const RasterPlacement& placement, double column, double row) {
  OGRSpatialReference from, to;
  from.importFromEPSG(placement.epsg);
  to.importFromEPSG(4326);
  to.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  OGRCoordinateTransformation* transform = OGRCreateCoordinateTransformation(&from, &to);
  double x = placement.west_m + column * placement.gsd_m, y = placement.north_m - row * placement.gsd_m;
  transform->Transform(1, &x, &y);
  OCTDestroyCoordinateTransformation(transform);
  return {x, y};
}

void write_picture(const std::filesystem::path& path, const cv::Mat_<cv::Vec3b>& bgr,
                   const RasterPlacement& placement) {
  GeoTiffWriter writer(path, bgr.size(), placement);
  writer.write_rows(bgr);
  writer.finish();
}

void write_camera(const std::filesystem::path& path, int width, int height, double focal_px, bool distorted) {
  write_file_atomic(path, fmt::format("model: pinhole\nwidth: {}\nheight: {}\nfx: {}\nfy: {}\ncx: {}\ncy: {}\n"
                                      "distortion: [{}]\n"
                                      "uncertainty: {{heading_deg: 3.0, agl_relative: 0.02, tilt_deg: 0.5}}\n",
                                      width, height, focal_px, focal_px + 2, width / 2.0 + 3, height / 2.0 - 2,
                                      distorted ? "-0.12, 0.05, 0.001, -0.0008, 0.0" : ""));
}

Mission mission_over(const RasterPlacement& placement, const std::vector<cv::Point2d>& route_px, double agl_m) {
  Mission mission;
  mission.id = "test";
  for (const cv::Point2d& p : route_px) mission.route.points.push_back(lonlat_at(placement, p.x, p.y));
  mission.takeoff = mission.route.points.front();
  mission.route.agl_m = agl_m;
  mission.route.corridor_half_width_m = 50;
  return mission;
}

}  // namespace nadir::test
