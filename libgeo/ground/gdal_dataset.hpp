// An open GDAL dataset: opening, its band layout, reading pixels. GDAL's own headers stay in the .cpp files.
#pragma once

#include <filesystem>
#include <memory>
#include <opencv2/core/types.hpp>
#include <string>
#include <vector>

#include "ground/picture.hpp"

class GDALDataset;

namespace nadir {

// GDAL prints errors on stderr unless told otherwise; for the current thread, while this lives, it only keeps them.
class QuietGdal {
 public:
  QuietGdal();
  ~QuietGdal();
  QuietGdal(const QuietGdal&) = delete;
  QuietGdal& operator=(const QuietGdal&) = delete;

  static std::string last_error();
};

struct CloseGdal {
  void operator()(GDALDataset* dataset) const;
};
using GdalHandle = std::unique_ptr<GDALDataset, CloseGdal>;

// Opens a raster file of any kind. Throws Error with GDAL's words.
GdalHandle open_gdal_raster(const std::filesystem::path& path);

// The files that the raster is read from, in GDAL's order: itself, its masks and overviews, the sources of a VRT.
std::vector<std::filesystem::path> files_of_raster(const std::filesystem::path& path);

class GdalDataset {
 public:
  explicit GdalDataset(const std::filesystem::path& path);
  ~GdalDataset();
  GdalDataset(const GdalDataset&) = delete;
  GdalDataset& operator=(const GdalDataset&) = delete;

  cv::Size size() const { return size_; }
  bool all_valid() const { return validity_ == Validity::all; }
  const std::filesystem::path& path() const { return path_; }
  GDALDataset* handle() const { return dataset_.get(); }

  // The window, averaged down to `size`.
  Picture read(const cv::Rect& window, cv::Size size) const;

 private:
  enum class Validity { all, nodata, mask };
  void find_layout();
  void check(bool ok, const char* doing) const;  // throws Error with GDAL's words
  cv::Mat read_mask(int band, const cv::Rect& window, cv::Size size) const;

  std::filesystem::path path_;
  GdalHandle dataset_;
  cv::Size size_;
  std::vector<int> bgr_bands_;  // three band numbers, alike for grey
  cv::Mat palette_;             // 1 x 256 CV_8UC3, empty without palette
  cv::Mat palette_mask_;        // 1 x 256 CV_8UC1
  Validity validity_ = Validity::all;
};

}  // namespace nadir
