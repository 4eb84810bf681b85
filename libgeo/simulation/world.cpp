#include "simulation/world.hpp"

#include <fmt/format.h>
#include <ogr_spatialref.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <exception>
#include <memory>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <thread>

#include "base/error.hpp"
#include "base/files.hpp"
#include "geodesy/local_frame.hpp"
#include "geodesy/web_mercator.hpp"
#include "simulation/geotiff_writer.hpp"
#include "simulation/landscape_rendering.hpp"
#include "simulation/world_vectors.hpp"

namespace nadir {
namespace {

class ToLonLat {
 public:
  explicit ToLonLat(const RasterPlacement& placement) : placement_(placement) {
    OGRSpatialReference from, to;
    from.importFromEPSG(placement.epsg);
    to.importFromEPSG(4326);
    from.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
    to.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
    transform_.reset(OGRCreateCoordinateTransformation(&from, &to));
    if (!transform_)
      throw Error(
          {.what = "PROJ cannot transform the world's coordinates", .fix = "check the installation of proj-data"});
  }
  LonLat operator()(double size_m, GroundPoint position) const {
    double x = placement_.west_m + position.x, y = placement_.north_m - size_m + position.y;
    if (!transform_->Transform(1, &x, &y)) throw Error({.what = "PROJ cannot transform the world's coordinates"});
    return {x, y};
  }

 private:
  RasterPlacement placement_;
  std::unique_ptr<OGRCoordinateTransformation> transform_;
};

std::string point(LonLat p) { return fmt::format("[{:.7f}, {:.7f}]", p.lon_deg, p.lat_deg); }

void write_item(const std::filesystem::path& folder, const std::string& name, const std::vector<LonLat>& ring,
                const std::string& time, const WorldOptions& options, double ce90_m, const GroundPoint& bias) {
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
        {"license", "CC0-1.0"},
        {"nadir:ce90_m", ce90_m}}},
      {"assets",
       {{"image", {{"href", name + ".tif"}, {"type", "image/tiff; application=geotiff"}, {"roles", {"data"}}}}}},
      {"links", nlohmann::json::array()}};
  if (name == "map") {
    item["properties"]["nadir:simulated_bias_m"] = {std::round(bias.x * 100) / 100, std::round(bias.y * 100) / 100};
  }
  write_file_atomic(folder / (name + ".json"), item.dump(2) + "\n");
}

// Several legs with turns in both directions, far enough inside that a banked camera still sees the world.
std::vector<GroundPoint> route_over(const Landscape& land) {
  std::vector<GroundPoint> route;
  for (const GroundPoint& p :
       {GroundPoint(.24, .24), GroundPoint(.74, .27), GroundPoint(.77, .50), GroundPoint(.28, .48),
        GroundPoint(.24, .71), GroundPoint(.50, .76), GroundPoint(.77, .73)}) {
    route.push_back(p * land.size_m);
  }
  return route;
}

}  // namespace

RasterPlacement world_placement(double size_m, double gsd_m) { return {32633, 428000, 5404000 + size_m, gsd_m}; }

double map_ce90_m(const Landscape& land) {
  std::vector<double> errors;
  for (double y = 25; y < land.size_m; y += 50) {
    for (double x = 25; x < land.size_m; x += 50) errors.push_back(cv::norm(map_bias_m(land.seed, {x, y})));
  }
  std::sort(errors.begin(), errors.end());
  return std::ceil(errors[errors.size() * 9 / 10] * 10) / 10;
}

void write_world_documents(const Landscape& land, const WorldOptions& options, const RasterPlacement& placement,
                           const std::filesystem::path& folder) {
  const ToLonLat lonlat(placement);
  const double size = land.size_m;
  const auto ring_at = [&](double inset) {
    std::vector<LonLat> ring;
    for (const GroundPoint& p : {GroundPoint(inset, inset), GroundPoint(size - inset, inset),
                                 GroundPoint(size - inset, size - inset), GroundPoint(inset, size - inset)}) {
      ring.push_back(lonlat(size, p));
    }
    ring.push_back(ring.front());
    return ring;
  };
  write_item(folder, "map", ring_at(0), "2025-05-11T10:12:00Z", options, map_ce90_m(land),
             map_bias_m(land.seed, {size / 2, size / 2}));
  write_item(folder, "ground", ring_at(0), "2025-09-18T13:40:00Z", options, 0.1, {});

  write_file_atomic(folder / "vectors.geojson",
                    world_vectors(land, [&](GroundPoint position) { return lonlat(size, position); }));

  std::string route, sector;
  const std::vector<GroundPoint> positions = route_over(land);
  for (const GroundPoint& position : positions) route += (route.empty() ? "" : ", ") + point(lonlat(size, position));
  for (const LonLat& p : ring_at(0.09 * size)) sector += (sector.empty() ? "" : ", ") + point(p);
  const LonLat start = lonlat(size, positions.front());
  int zoom = 10;
  while (zoom < 22 && ground_resolution_m(zoom, start.lat_deg) > options.gsd_m * 1.02) ++zoom;
  const double agl = size >= 1500 ? 280 : std::max(60.0, 280 * size / 1500);
  write_file_atomic(
      folder / "mission.yaml",
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
                  options.seed, options.seed, start.lon_deg, start.lat_deg, land.relief.at(positions.front()),
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

namespace {

constexpr int kPiece = 1344;  // pixels; a piece and its margin take a few hundred megabytes

void render_band(const Landscape& land, const Painter& painter, View view, double gsd_m, int first_row,
                 cv::Mat_<cv::Vec3b>& band) {
  const int pieces = (band.cols + kPiece - 1) / kPiece;
  std::atomic<int> next{0};
  std::exception_ptr failure;
  std::atomic<bool> failed{false};
  const auto work = [&] {
    for (int i = next++; i < pieces && !failed; i = next++) {
      try {
        const int left = i * kPiece, columns = std::min(kPiece, band.cols - left);
        const PixelGrid grid{gsd_m, land.size_m, left, first_row, columns, band.rows};
        render_view(land, painter, view, grid).copyTo(band.colRange(left, left + columns));
      } catch (...) {
        if (!failed.exchange(true)) failure = std::current_exception();
      }
    }
  };
  const auto workers = std::clamp<unsigned>(std::thread::hardware_concurrency(), 1, 8);
  {
    std::vector<std::jthread> threads;
    for (unsigned i = 1; i < workers; ++i) threads.emplace_back(work);
    work();
  }
  if (failure) std::rethrow_exception(failure);
}

}  // namespace

WorldReport make_world(const WorldOptions& options, const std::filesystem::path& folder, Progress& progress) {
  const int side = static_cast<int>(std::lround(options.size_km * 1000 / options.gsd_m));
  const double size_m = side * options.gsd_m;
  const Landscape land = generate_landscape(options.seed, size_m);
  WorldReport report;
  report.side_px = side;
  report.parcels = land.fields.parcels.size();
  report.buildings = land.buildings.size();
  report.trees = land.trees.size();
  double low = 0, high = 0;
  cv::minMaxLoc(land.relief.heights_m, &low, &high);
  report.relief_m = high - low;
  report.map_ce90_m = map_ce90_m(land);

  const RasterPlacement placement = world_placement(size_m, options.gsd_m);
  const int bands = (side + kPiece - 1) / kPiece;
  progress.begin("painting", static_cast<std::uint64_t>(2 * bands), "strips");
  for (const View view : {View::day, View::satellite}) {
    const Painter painter(land, view == View::day ? Season::september : Season::may);
    GeoTiffWriter writer(folder / (view == View::day ? "ground.tif" : "map.tif"), {side, side}, placement);
    for (int row = 0; row < side; row += kPiece) {
      cv::Mat_<cv::Vec3b> band(std::min(kPiece, side - row), side);
      render_band(land, painter, view, options.gsd_m, row, band);
      writer.write_rows(band);
      progress.advance(1);
    }
    writer.finish();
  }
  progress.end();
  RasterPlacement heights = placement;
  heights.gsd_m = land.relief.step_m;
  write_heights(folder / "dem.tif", land.relief.heights_m, heights);
  write_world_documents(land, options, placement, folder);
  return report;
}

}  // namespace nadir
