// GeoTIFF files of the simulated images, written from top to bottom.
#pragma once

#include <filesystem>
#include <memory>
#include <opencv2/core/mat.hpp>

namespace nadir {

// Where a north-up raster lies: the outer corner of its first pixel in a projected system, and the size of a pixel.
struct RasterPlacement {
  int epsg = 32633;
  double west_m = 0;
  double north_m = 0;
  double gsd_m = 1;
};

class GeoTiffWriter {
 public:
  GeoTiffWriter(const std::filesystem::path& path, cv::Size size, const RasterPlacement& placement);
  ~GeoTiffWriter();
  void write_rows(const cv::Mat_<cv::Vec3b>& bgr);  // the next ones
  void finish();                                    // throws Error when the file is not complete

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

void write_heights(const std::filesystem::path& path, const cv::Mat_<float>& heights_m,
                   const RasterPlacement& placement);

}  // namespace nadir
