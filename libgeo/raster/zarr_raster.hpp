// Zarr (zarr-specs.readthedocs.io): a folder of arrays in chunks, each a file. GDAL reads its arrays; which of them are
// an image is said here:
//
//   one array of bands, rows and columns, in any order (xarray, rioxarray), or
//   arrays of rows and columns alike: one in grey; red, green and blue by name; or Band1, Band2 … as GDAL writes them.
//
// The first three bands are red, green and blue. Dimensions are known by the names of their coordinates (x, lon,
// easting, …); the coordinate system is the array's attribute _CRS, as GDAL has it. A chunk that is missing has the
// array's fill value by definition: it counts as nodata, and where an array has none, all chunks must be there.
#pragma once

#include <filesystem>
#include <vector>

#include "raster/gdal_dataset.hpp"

namespace nadir {

bool is_zarr(const std::filesystem::path& path);

// Throws Error for a folder that holds no image.
GdalHandle open_zarr(const std::filesystem::path& folder);

// All files beneath, sorted: what the image is read from.
std::vector<std::filesystem::path> files_of_zarr(const std::filesystem::path& folder);

}  // namespace nadir
