// Any raster that GDAL reads, as 8 bit colours with a mask of what is valid, addressed by Web Mercator pixels.
//
// Understood: grey, grey with alpha, palette, RGB, RGB with alpha; further bands (near infrared) are left out. Numbers
// other than 8 bit ones are stretched. Invalid are pixels under the dataset's mask, with alpha below one half, with all
// colours equal to their nodata, or with a colour that is no finite number: as they stand in the file, before any
// stretch. One object serves one thread; several may read the same file.
#pragma once

#include <filesystem>
#include <memory>
#include <opencv2/core/types.hpp>
#include <optional>
#include <vector>

#include "geodesy/web_mercator.hpp"
#include "raster/picture.hpp"
#include "raster/stretch.hpp"

namespace nadir {

class RasterSource {
 public:
  // Throws Error when the file is missing, of no known format, damaged, not georeferenced, or not 8 bit without a
  // stretch. A raster that is 8 bit keeps its values.
  explicit RasterSource(const std::filesystem::path& path, std::optional<Stretch> stretch = {});
  ~RasterSource();
  RasterSource(RasterSource&&) noexcept;
  RasterSource& operator=(RasterSource&&) noexcept;

  // The raster's outline on the Web Mercator plane: a closed ring, points along its edges.
  const std::vector<MercatorXY>& outline() const;

  // The given rectangle of global pixels of a zoom. Pixels that average several of the raster's are averages; pixels
  // outside have mask 0. Throws Error for parts of the file that do not read.
  Picture read(int zoom, const cv::Rect& pixels);

  const std::filesystem::path& path() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace nadir
