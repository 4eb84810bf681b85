// An open GDAL dataset: opening, reading pixels. GDAL's own headers stay in the .cpp files.
#pragma once

#include <filesystem>
#include <memory>
#include <opencv2/core/types.hpp>
#include <optional>
#include <string>
#include <vector>

#include "raster/band_layout.hpp"
#include "raster/picture.hpp"
#include "raster/stretch.hpp"

class GDALDataset;
class GDALRasterBand;

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

// Values of some pixels, before they become colours.
struct Samples {
  cv::Mat values;  // CV_32FC1 for grey, else CV_32FC3 in the order of BandLayout::bgr
  cv::Mat mask;    // CV_8UC1, 255 where they are valid: finite, and no nodata of any kind
};

class GdalDataset {
 public:
  // stretch: for a raster that is not 8 bit; others keep their values.
  explicit GdalDataset(const std::filesystem::path& path, std::optional<Stretch> stretch = {});
  ~GdalDataset();
  GdalDataset(const GdalDataset&) = delete;
  GdalDataset& operator=(const GdalDataset&) = delete;

  cv::Size size() const { return size_; }
  const BandLayout& layout() const { return layout_; }
  const std::filesystem::path& path() const { return path_; }
  GDALDataset* handle() const { return dataset_.get(); }

  // The window, averaged down to `size`: averages of the file's values, stretched afterwards.
  Picture read(const cv::Rect& window, cv::Size size) const;
  Samples read_samples(const cv::Rect& window, cv::Size size) const;  // of a raster without palette

 private:
  void check(bool ok, const char* doing) const;  // throws Error with GDAL's words
  cv::Mat read_band(GDALRasterBand& band, int type, const cv::Rect& window, cv::Size size, bool average) const;
  cv::Mat read_colours(int depth, const cv::Rect& window, cv::Size size) const;
  cv::Mat read_validity(const cv::Rect& window, cv::Size size) const;
  Picture read_palette(const cv::Rect& window, cv::Size size) const;

  std::filesystem::path path_;
  GdalHandle dataset_;
  cv::Size size_;
  BandLayout layout_;
  std::optional<Stretch> stretch_;
};

}  // namespace nadir
