// A raster file through GDAL: opening, its bands, reading windows of pixels. GDAL's own headers stay in the .cpp files.
//
// Only files on this machine and pinned objects (pinned_files.hpp) are read: the result of a build must depend on bytes
// that have a digest.
#pragma once

#include <array>
#include <filesystem>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>
#include <optional>
#include <string>
#include <vector>

#include "raster/masked_image.hpp"
#include "raster/stretch.hpp"

class GDALDataset;
class GDALRasterBand;

namespace nadir {

class PinnedObject;

// GDAL prints errors on stderr by default. While this lives, GDAL only keeps the errors of the current thread.
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

// Opens a raster file of any format, a Zarr folder, an item of tiled assets, or a mounted object. Throws Error with GDAL's message, UsageError for other remote
// rasters.
GdalHandle open_gdal_raster(const std::filesystem::path& path);

// The files that the raster is read from, in GDAL's order: itself, its masks and overviews, the sources of a VRT.
std::vector<std::filesystem::path> files_of_raster(const std::filesystem::path& path);

// Which bands of a raster are its colours, and what marks its valid pixels.
struct BandLayout {
  enum class Validity { all, nodata, mask, alpha };

  std::array<int, 3> bgr{1, 1, 1};  // band numbers; three times the same for grey
  bool eight_bit = true;            // of type Byte, or a palette of 8 bit colours
  const char* type = "Byte";        // GDAL's name of the type
  cv::Mat palette;                  // 1 x entries CV_8UC3, empty without palette
  cv::Mat palette_mask;             // 1 x entries CV_8UC1; empty when every entry is opaque
  Validity validity = Validity::all;
  int alpha_band = 0;     // with Validity::alpha
  double alpha_half = 0;  // values from here on are opaque

  bool grey() const { return bgr[0] == bgr[2]; }
};

// Bands with red, green and blue as colour interpretation are used as such; otherwise the first three, or the first as
// grey. Throws UsageError for rasters without bands, of complex numbers, or with an alpha of an unsupported type.
BandLayout find_band_layout(GDALDataset& dataset, const std::filesystem::path& path);

// Raw values of a window, before they become colours.
struct RasterSamples {
  cv::Mat values;  // CV_32FC1 for grey, else CV_32FC3 in the order of BandLayout::bgr
  cv::Mat mask;    // CV_8UC1, 255 where the values are valid: finite and not nodata
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

  // The window, averaged down to `size`. The file's values are averaged first and stretched afterwards.
  MaskedImage read(const cv::Rect& window, cv::Size size) const;
  RasterSamples read_samples(const cv::Rect& window, cv::Size size) const;  // of a raster without palette

 private:
  void check(bool ok, const char* doing) const;  // throws Error with GDAL's message
  cv::Mat read_band(GDALRasterBand& band, int type, const cv::Rect& window, cv::Size size, bool average) const;
  cv::Mat read_colours(int depth, const cv::Rect& window, cv::Size size) const;
  cv::Mat read_validity(const cv::Rect& window, cv::Size size) const;
  MaskedImage read_palette(const cv::Rect& window, cv::Size size) const;

  std::filesystem::path path_;
  const PinnedObject* object_;  // null for a file on this machine
  GdalHandle dataset_;
  cv::Size size_;
  BandLayout layout_;
  std::optional<Stretch> stretch_;
};

}  // namespace nadir
