#include "simulation/world_extent.hpp"

#include <algorithm>
#include <cmath>

#include "raster/gdal_dataset.hpp"
#include "simulation/georeference.hpp"

namespace nadir {

WorldExtent extent_of_world(const std::filesystem::path& path) {
  const GdalDataset dataset(path);
  const Georeference geo(*dataset.handle(), path);
  WorldExtent extent;
  extent.size = dataset.size();
  const double width = extent.size.width, height = extent.size.height;
  extent.centre = geo.lonlat_from_pixel(width / 2, height / 2);
  const LocalFrame frame(extent.centre);
  const auto at = [&](double column, double row) { return frame.enu_from_lonlat(geo.lonlat_from_pixel(column, row)); };
  const Enu right = at(width / 2 + 1, height / 2), down = at(width / 2, height / 2 + 1);
  extent.gsd_m = std::sqrt(std::abs(right.east_m * down.north_m - right.north_m * down.east_m));
  extent.box = {1e12, 1e12, -1e12, -1e12};
  constexpr int kSteps = 16;  // along each edge: a projection's edges are curved
  for (int i = 0; i <= kSteps; ++i) {
    const double t = static_cast<double>(i) / kSteps;
    for (const Enu& p : {at(t * width, 0), at(t * width, height), at(0, t * height), at(width, t * height)}) {
      extent.box.west_m = std::min(extent.box.west_m, p.east_m);
      extent.box.east_m = std::max(extent.box.east_m, p.east_m);
      extent.box.south_m = std::min(extent.box.south_m, p.north_m);
      extent.box.north_m = std::max(extent.box.north_m, p.north_m);
    }
  }
  return extent;
}

}  // namespace nadir
