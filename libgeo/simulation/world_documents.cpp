#include "simulation/world_documents.hpp"

#include <fmt/format.h>
#include <ogr_spatialref.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/files.hpp"
#include "geodesy/local_frame.hpp"
#include "geodesy/web_mercator.hpp"
#include "simulation/world_pictures.hpp"

namespace nadir {
namespace {

class ToLonLat {
 public:
  explicit ToLonLat(const Placement& placement) : placement_(placement) {
    OGRSpatialReference from, to;
    from.importFromEPSG(placement.epsg);
    to.importFromEPSG(4326);
    from.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
    to.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
    transform_.reset(OGRCreateCoordinateTransformation(&from, &to));
    if (!transform_) throw Error({.what = "PROJ cannot place the world", .fix = "check the installation of proj-data"});
  }
  LonLat operator()(double size_m, Spot spot) const {
    double x = placement_.west_m + spot.x, y = placement_.north_m - size_m + spot.y;
    if (!transform_->Transform(1, &x, &y)) throw Error({.what = "PROJ cannot place the world"});
    return {x, y};
  }

 private:
  Placement placement_;
  std::unique_ptr<OGRCoordinateTransformation> transform_;
};

std::string point(LonLat p) { return fmt::format("[{:.7f}, {:.7f}]", p.lon_deg, p.lat_deg); }

void write_item(const std::filesystem::path& folder, const std::string& name, const std::vector<LonLat>& ring,
                const std::string& time, const WorldOptions& options, double ce90_m, const Spot& bias) {
  nlohmann::json coordinates = nlohmann::json::array();
  double west = 180, south = 90, east = -180, north = -90;
  const auto rounded = [](double v) { return std::round(v * 1e7) / 1e7; };
  for (const LonLat& p : ring) {
    coordinates.push_back({rounded(p.lon_deg), rounded(p.lat_deg)});
    west = std::min(west, p.lon_deg), east = std::max(east, p.lon_deg);
    south = std::min(south, p.lat_deg), north = std::max(north, p.lat_deg);
  }
  nlohmann::json item = {
      {"type", "Feature"},
      {"stac_version", "1.0.0"},
      {"id", fmt::format("nadir-world-{}-{}", options.seed, name)},
      {"bbox", {rounded(west), rounded(south), rounded(east), rounded(north)}},
      {"geometry", {{"type", "Polygon"}, {"coordinates", nlohmann::json::array({coordinates})}}},
      {"properties",
       {{"datetime", time},
        {"gsd", options.gsd_m},
        {"providers", nlohmann::json::array({{{"name", "nadir simulate world"}, {"roles", {"producer"}}}})},
        {"nadir:ce90_m", ce90_m}}},
      {"assets",
       {{"image", {{"href", name + ".tif"}, {"type", "image/tiff; application=geotiff"}, {"roles", {"data"}}}}}},
      {"links", nlohmann::json::array()}};
  if (name == "map") {
    item["properties"]["nadir:simulated_bias_m"] = {std::round(bias.x * 100) / 100, std::round(bias.y * 100) / 100};
  }
  write_file_atomic(folder / (name + ".json"), item.dump(2) + "\n");
}

// Several legs with turns both ways, all far enough inside that a banked picture still sees the world.
std::vector<Spot> route_over(const Landscape& land) {
  std::vector<Spot> route;
  for (const Spot& p : {Spot(.24, .24), Spot(.74, .27), Spot(.77, .50), Spot(.28, .48), Spot(.24, .71), Spot(.50, .76),
                        Spot(.77, .73)}) {
    route.push_back(p * land.size_m);
  }
  return route;
}

}  // namespace

Placement world_placement(double size_m, double gsd_m) { return {32633, 428000, 5404000 + size_m, gsd_m}; }

double map_ce90_m(const Landscape& land) {
  std::vector<double> errors;
  for (double y = 25; y < land.size_m; y += 50) {
    for (double x = 25; x < land.size_m; x += 50) errors.push_back(cv::norm(map_bias_m(land.seed, {x, y})));
  }
  std::sort(errors.begin(), errors.end());
  return std::ceil(errors[errors.size() * 9 / 10] * 10) / 10;
}

void write_world_documents(const Landscape& land, const WorldOptions& options, const Placement& placement,
                           const std::filesystem::path& folder) {
  const ToLonLat lonlat(placement);
  const double size = land.size_m;
  const auto ring_at = [&](double inset) {
    std::vector<LonLat> ring;
    for (const Spot& p :
         {Spot(inset, inset), Spot(size - inset, inset), Spot(size - inset, size - inset), Spot(inset, size - inset)}) {
      ring.push_back(lonlat(size, p));
    }
    ring.push_back(ring.front());
    return ring;
  };
  write_item(folder, "map", ring_at(0), "2025-05-11T10:12:00Z", options, map_ce90_m(land),
             map_bias_m(land.seed, {size / 2, size / 2}));
  write_item(folder, "ground", ring_at(0), "2025-09-18T13:40:00Z", options, 0.1, {});

  std::string route, sector;
  const std::vector<Spot> spots = route_over(land);
  for (const Spot& spot : spots) route += (route.empty() ? "" : ", ") + point(lonlat(size, spot));
  for (const LonLat& p : ring_at(0.09 * size)) sector += (sector.empty() ? "" : ", ") + point(p);
  const LonLat start = lonlat(size, spots.front());
  int zoom = 10;
  while (zoom < 22 && ground_resolution_m(zoom, start.lat_deg) > options.gsd_m * 1.02) ++zoom;
  const double agl = size >= 1500 ? 280 : std::max(60.0, 280 * size / 1500);
  write_file_atomic(folder / "mission.yaml",
                    fmt::format("# A flight over the simulated world of seed {}: fields, a village and a river.\n"
                                "schema: nadir.mission/1\n"
                                "id: world-{}\n"
                                "series: simulated-world\n"
                                "sequence: 1\n"
                                "created: 2025-09-17T00:00:00Z\n"
                                "expires: 2025-12-31T00:00:00Z\n"
                                "takeoff: {{lon_deg: {:.7f}, lat_deg: {:.7f}}}\n"
                                "terrain: {{mode: dem, height_m: {:.1f}}}\n"
                                "zoom: {{min: {}, max: {}}}\n"
                                "min_resolution_m: {:.3g}\n"
                                "budget_mb: 500\n"
                                "freshness_days: {{stable: 730, active: 200}}\n"
                                "airframes: [any]\n"
                                "sectors:\n"
                                "  - id: valley\n"
                                "    class: stable\n"
                                "    polygon: [{}]\n"
                                "route:\n"
                                "  corridor_half_width_m: {:.0f}\n"
                                "  agl_m: {:.0f}\n"
                                "  points: [{}]\n",
                                options.seed, options.seed, start.lon_deg, start.lat_deg, land.relief.at(spots.front()),
                                std::max(10, zoom - 4), zoom, options.gsd_m * 1.2, sector, 0.07 * size, agl, route));
  write_file_atomic(folder / "camera.yaml",
                    std::string_view("# The demo's camera: 65 degrees wide, a mild barrel distortion.\n"
                                     "model: pinhole\n"
                                     "width: 1280\n"
                                     "height: 720\n"
                                     "fx: 1002.5\n"
                                     "fy: 1001.8\n"
                                     "cx: 643.2\n"
                                     "cy: 356.9\n"
                                     "distortion: [-0.085, 0.032, 0.0004, -0.0003, 0.0]   # k1 k2 p1 p2 k3\n"
                                     "uncertainty:   # one sigma of the telemetry\n"
                                     "  heading_deg: 2.5\n"
                                     "  agl_relative: 0.03\n"
                                     "  tilt_deg: 0.8\n"));
}

}  // namespace nadir
