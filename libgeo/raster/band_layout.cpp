#include "raster/band_layout.hpp"

#include <fmt/format.h>
#include <gdal_priv.h>

#include <algorithm>
#include <opencv2/core.hpp>

#include "base/error.hpp"

namespace nadir {
namespace {

int band_with(GDALDataset& dataset, GDALColorInterp colour) {
  for (int i = 1; i <= dataset.GetRasterCount(); ++i) {
    if (dataset.GetRasterBand(i)->GetColorInterpretation() == colour) return i;
  }
  return 0;
}

std::array<int, 3> colour_bands(GDALDataset& dataset, int alpha) {
  const std::array<int, 3> named{band_with(dataset, GCI_BlueBand), band_with(dataset, GCI_GreenBand),
                                 band_with(dataset, GCI_RedBand)};
  if (std::count(named.begin(), named.end(), 0) == 0) return named;
  const int first = alpha == 1 && dataset.GetRasterCount() > 1 ? 2 : 1;
  const int colours = dataset.GetRasterCount() - (alpha != 0 ? 1 : 0);
  if (colours < 3 || alpha == 2 || alpha == 3) return {first, first, first};
  return {first + 2, first + 1, first};
}

void take_palette(GDALRasterBand& band, BandLayout& layout) {
  const GDALColorTable* table = band.GetColorTable();
  if (table == nullptr || !layout.grey()) return;
  const GDALDataType type = band.GetRasterDataType();
  if (type != GDT_Byte && type != GDT_UInt16) return;
  const int entries = std::clamp(table->GetColorEntryCount(), 1, 65536);
  layout.palette = cv::Mat::zeros(1, entries, CV_8UC3);
  layout.palette_mask = cv::Mat::zeros(1, entries, CV_8UC1);
  for (int i = 0; i < table->GetColorEntryCount() && i < entries; ++i) {
    GDALColorEntry entry;
    table->GetColorEntryAsRGB(i, &entry);
    layout.palette.at<cv::Vec3b>(i) = {static_cast<std::uint8_t>(entry.c3), static_cast<std::uint8_t>(entry.c2),
                                       static_cast<std::uint8_t>(entry.c1)};
    layout.palette_mask.at<std::uint8_t>(i) = entry.c4 >= 128 ? 255 : 0;
  }
  if (cv::countNonZero(layout.palette_mask) == entries) layout.palette_mask.release();
}

double opaque_half(GDALRasterBand& alpha, const std::filesystem::path& path) {
  switch (alpha.GetRasterDataType()) {
    case GDT_Byte: return 128;
    case GDT_UInt16: return 32768;
    default: break;
  }
  throw UsageError({.what = "the alpha band is of a type that has no opaque value",
                    .where = fmt::format("{} (band {})", path.string(), alpha.GetBand()),
                    .expected = "Byte or UInt16",
                    .found = GDALGetDataTypeName(alpha.GetRasterDataType()),
                    .fix = "make a mask of it: gdal_translate -b 1 -b 2 -b 3 -mask 4 IN.tif OUT.tif"});
}

}  // namespace

BandLayout find_band_layout(GDALDataset& dataset, const std::filesystem::path& path) {
  if (dataset.GetRasterCount() < 1) throw UsageError({.what = "the raster has no bands", .where = path.string()});
  BandLayout layout;
  const int alpha = band_with(dataset, GCI_AlphaBand);
  layout.bgr = colour_bands(dataset, alpha);
  GDALRasterBand& first = *dataset.GetRasterBand(layout.bgr[2]);
  take_palette(first, layout);
  for (const int number : layout.bgr) {
    const GDALDataType type = dataset.GetRasterBand(number)->GetRasterDataType();
    if (GDALDataTypeIsComplex(type) != 0) {
      throw UsageError({.what = "the raster is of complex numbers",
                        .where = fmt::format("{} (band {})", path.string(), number),
                        .expected = "a picture",
                        .found = GDALGetDataTypeName(type),
                        .fix = "make magnitudes of it first"});
    }
    if (type == GDT_Byte || !layout.palette.empty()) continue;
    layout.eight_bit = false;
    layout.type = GDALGetDataTypeName(type);
  }
  const int flags = first.GetMaskFlags();
  if (alpha != 0 && ((flags & GMF_ALL_VALID) != 0 || (flags & GMF_ALPHA) != 0)) {
    layout.validity = BandLayout::Validity::alpha;
    layout.alpha_band = alpha;
    layout.alpha_half = opaque_half(*dataset.GetRasterBand(alpha), path);
  } else if ((flags & GMF_ALL_VALID) != 0) {
    layout.validity = BandLayout::Validity::all;
  } else if ((flags & GMF_NODATA) != 0) {
    layout.validity = BandLayout::Validity::nodata;
  } else {
    layout.validity = BandLayout::Validity::mask;
  }
  return layout;
}

}  // namespace nadir
