// Rasters of any type and container whose pixels are pixels of the map at zoom 19: what is read back is exact.
#pragma once

#include <gdal_priv.h>

#include <filesystem>
#include <functional>
#include <limits>
#include <opencv2/core/types.hpp>
#include <optional>
#include <string>
#include <vector>

namespace nadir::test {

inline constexpr int kValueZoom = 19;
inline const cv::Rect kValuePixels{112'000'000, 57'800'000, 32, 24};  // of the world's map

struct ValueRaster {
  GDALDataType type = GDT_UInt16;
  int bands = 1;
  std::function<double(int band, int column, int row)> value;  // band from 1
  std::vector<GDALColorInterp> colours{};
  std::vector<std::optional<double>> nodata{};            // for each band
  std::function<bool(int column, int row)> masked_out{};  // into a mask for all bands
  std::vector<GDALColorEntry> palette{};
  bool south_up = false;
  cv::Size size = kValuePixels.size();
  std::vector<std::string> options{};
};

void write_values(const std::filesystem::path& path, const ValueRaster& raster);

}  // namespace nadir::test
