// Which bands of a raster are its colours, and what says where it shows ground.
#pragma once

#include <array>
#include <filesystem>
#include <opencv2/core/mat.hpp>

class GDALDataset;

namespace nadir {

struct BandLayout {
  enum class Validity { all, nodata, mask, alpha };

  std::array<int, 3> bgr{1, 1, 1};  // band numbers, alike for grey
  bool eight_bit = true;            // of type Byte, or a palette of 8 bit colours
  const char* type = "Byte";        // GDAL's name of the type
  cv::Mat palette;                  // 1 x entries CV_8UC3, empty without palette
  cv::Mat palette_mask;             // 1 x entries CV_8UC1; empty when every entry is opaque
  Validity validity = Validity::all;
  int alpha_band = 0;     // with Validity::alpha
  double alpha_half = 0;  // opaque from here on

  bool grey() const { return bgr[0] == bgr[2]; }
};

// Bands that say that they are red, green and blue are taken as such; else the first three, or the first as grey.
// Throws UsageError for rasters without bands, of complex numbers, or with an alpha of a type that has no opaque value.
BandLayout find_band_layout(GDALDataset& dataset, const std::filesystem::path& path);

}  // namespace nadir
