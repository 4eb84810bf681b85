// Terrain files for tests, made by GDAL's own programs from an ASCII grid: independent of the code that reads them.
#pragma once

#include <fmt/format.h>

#include <filesystem>
#include <functional>
#include <stdexcept>
#include <string>
#include <vector>

#include "imagery/terrain_raster.hpp"
#include "support/process.hpp"
#include "support/temporary_folder.hpp"

namespace nadir::test {

inline constexpr double kNodata = -32767;

// The options of gdal_translate that make a file as packages hold it.
inline const std::vector<std::string> kAsPackagesHoldIt{
    "-ot", "Float32",          "-a_srs", "EPSG:4326",   "-a_nodata", "-32767",        "-co", "TILED=YES",
    "-co", "COMPRESS=DEFLATE", "-co",    "PREDICTOR=3", "-co",       "BLOCKXSIZE=32", "-co", "BLOCKYSIZE=32"};

// Square cells of `step_deg`. height(column, row): from the north-west.
inline std::filesystem::path write_terrain_file(const TemporaryFolder& folder, const std::string& name,
                                                const TerrainGrid& grid, const std::function<double(int, int)>& height,
                                                std::vector<std::string> options = kAsPackagesHoldIt) {
  std::string text = fmt::format("ncols {}\nnrows {}\nxllcorner {:.12f}\nyllcorner {:.12f}\ncellsize {:.12f}\n",
                                 grid.columns, grid.rows, grid.west_deg, grid.south_deg(), grid.lon_step_deg);
  for (int row = 0; row < grid.rows; ++row) {
    for (int column = 0; column < grid.columns; ++column) text += fmt::format("{:.6f} ", height(column, row));
    text += '\n';
  }
  const auto ascii = folder.write(name + ".asc", text);
  std::vector<std::string> command{"gdal_translate", "-q"};
  command.insert(command.end(), options.begin(), options.end());
  command.insert(command.end(), {ascii.string(), (folder / name).string()});
  const ProcessResult result = run_process(command);
  if (result.code != 0) throw std::runtime_error(result.err);
  std::filesystem::remove(ascii);
  return folder / name;
}

}  // namespace nadir::test
