// Any raster that GDAL reads, as 8 bit colours with a validity mask, resampled to Web Mercator pixels.
//
// Supported: grey, grey with alpha, palette, RGB, RGB with alpha; further bands (near infrared) are ignored. Values
// that are not 8 bit are stretched. Invalid are pixels under the dataset's mask, with alpha below one half, with all
// colours equal to their nodata, or with a colour that is not finite: as stored in the file, before any stretch.
//
// Pixels are placed by bilinear interpolation between nodes that GDAL transforms exactly. Where a map pixel covers
// several raster pixels, they are averaged. One object serves one thread; several may read the same file.
#pragma once

#include <filesystem>
#include <memory>
#include <opencv2/core/types.hpp>
#include <optional>
#include <vector>

#include "geodesy/web_mercator.hpp"
#include "raster/masked_image.hpp"
#include "raster/stretch.hpp"

namespace nadir {

class RasterSource {
 public:
  // Throws Error when the file is missing, of an unknown format, damaged, not georeferenced, or not 8 bit without a
  // stretch. A raster that is 8 bit keeps its values.
  explicit RasterSource(const std::filesystem::path& path, std::optional<Stretch> stretch = {});
  ~RasterSource();
  RasterSource(RasterSource&&) noexcept;
  RasterSource& operator=(RasterSource&&) noexcept;

  // The raster's outline on the Web Mercator plane: a ring (the last point does not repeat the first) with points along
  // its edges.
  const std::vector<MercatorXY>& outline() const;

  // Side of a pixel on the ground, on average over the raster.
  double pixel_m() const;

  // How precisely the file itself states its place: 0 when that is no concern. NITF has corners in whole seconds or
  // thousandths of a degree, unless it carries BLOCKA, or an .aux.xml file with a geotransform lies beside it.
  double place_precision_m() const;

  // The given rectangle of global pixels of a zoom. Pixels outside of the raster have mask 0. Throws Error for parts of
  // the file that cannot be read.
  MaskedImage read(int zoom, const cv::Rect& pixels);

  const std::filesystem::path& path() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace nadir
