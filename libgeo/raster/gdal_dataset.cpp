#include "raster/gdal_dataset.hpp"

#include <fmt/format.h>
#include <gdal_priv.h>

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "object_storage/object_address.hpp"
#include "raster/gdal_drivers.hpp"
#include "raster/pinned_files.hpp"
#include "raster/stac.hpp"
#include "raster/tiled_assets.hpp"
#include "raster/zarr_raster.hpp"

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
  throw UsageError({.what = "the type of the alpha band is not supported",
                    .where = fmt::format("{} (band {})", path.string(), alpha.GetBand()),
                    .expected = "Byte or UInt16",
                    .found = GDALGetDataTypeName(alpha.GetRasterDataType()),
                    .fix = "convert it to a mask: gdal_translate -b 1 -b 2 -b 3 -mask 4 IN.tif OUT.tif"});
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
      throw UsageError({.what = "the raster holds complex numbers",
                        .where = fmt::format("{} (band {})", path.string(), number),
                        .expected = "an image",
                        .found = GDALGetDataTypeName(type),
                        .fix = "convert it to magnitudes first"});
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

namespace {

constexpr int kMaxVrtDepth = 4;

// Throws UsageError when one of them is remote.
std::vector<std::filesystem::path> list_files(const std::filesystem::path& path, GDALDataset& dataset, int depth) {
  std::vector<std::filesystem::path> files;
  const std::unique_ptr<char*, decltype(&CSLDestroy)> list(dataset.GetFileList(), &CSLDestroy);
  for (int i = 0; i < CSLCount(list.get()); ++i) {
    const std::string name = list.get()[i];
    if (is_remote_name(name)) reject_remote(path, name);
    if (!std::filesystem::is_regular_file(name)) continue;
    files.emplace_back(name);
    if (depth == 0 || i == 0 || files.back().extension() != ".vrt") continue;
    const GdalHandle nested(GDALDataset::Open(name.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY));
    if (!nested) continue;
    for (auto& file : list_files(path, *nested, depth - 1)) files.push_back(std::move(file));
  }
  return files;
}

// In double precision and without machine-dependent vector instructions: the same bytes everywhere.
cv::Mat stretched(const cv::Mat& values, const Stretch& line) {
  cv::Mat colours(values.size(), CV_MAKETYPE(CV_8U, values.channels()));
  for (int row = 0; row < values.rows; ++row) {
    const auto* in = values.ptr<float>(row);
    auto* out = colours.ptr<std::uint8_t>(row);
    for (int i = 0; i < values.cols * values.channels(); ++i) {
      const double colour = 255.0 * (static_cast<double>(in[i]) - line.low) / (line.high - line.low);
      out[i] = static_cast<std::uint8_t>(std::clamp(colour, 0.0, 255.0) + 0.5);
    }
  }
  return colours;
}

}  // namespace

QuietGdal::QuietGdal() {
  CPLPushErrorHandler(CPLQuietErrorHandler);
  CPLErrorReset();
}
QuietGdal::~QuietGdal() { CPLPopErrorHandler(); }

std::string QuietGdal::last_error() {
  const char* message = CPLGetLastErrorMsg();
  return message != nullptr && *message != '\0' ? message : "GDAL gave no reason";
}

void CloseGdal::operator()(GDALDataset* dataset) const { GDALClose(dataset); }

GdalDataset::~GdalDataset() = default;

namespace {

// Formats that are one file, with all that belongs to them in it.
constexpr std::array kObjectDrivers = {"GTiff", "JP2OpenJPEG", "NITF",
                                       "GPKG",  "MBTiles",     static_cast<const char*>(nullptr)};

GdalHandle open_object(const PinnedObject& object) {
  GdalHandle dataset(GDALDataset::Open(gdal_name(object.pin().address.url).c_str(),
                                       GDAL_OF_RASTER | GDAL_OF_READONLY | GDAL_OF_VERBOSE_ERROR,
                                       kObjectDrivers.data()));
  object.require_sound();
  if (dataset) return dataset;
  throw Error({.what = "the pinned object cannot be opened as a raster",
               .where = object.pin().address.url,
               .expected = "GeoTIFF or COG, JPEG 2000, NITF, GeoPackage or MBTiles, complete in one file",
               .found = QuietGdal::last_error(),
               .fix = "convert it: gdal_translate -of COG"});
}

// A.TOC of CADRG and CIB, TOC.xml of ECRG: several maps of several scales, of which the frames are the pictures.
bool is_table_of_contents(const std::filesystem::path& path) {
  const std::string name = path.filename().string();
  return EQUAL(name.c_str(), "A.TOC") || EQUAL(name.c_str(), "TOC.xml");
}

}  // namespace

GdalHandle open_gdal_raster(const std::filesystem::path& path) {
  const QuietGdal quiet;
  register_gdal_drivers();
  if (const PinnedObject* object = mounted_object(path)) return open_object(*object);
  if (is_remote_name(path.string())) reject_remote(path, path.string());
  if (is_zarr(path)) return open_zarr(path);
  if (!std::filesystem::is_regular_file(path)) {
    throw Error({.what = std::filesystem::exists(path) ? "the raster is not a file" : "the raster does not exist",
                 .where = path.string(),
                 .fix = "check the path"});
  }
  if (is_stac_name(path.string())) return open_tiled_assets(path);
  refuse_remote_raster(path);
  GdalHandle dataset(GDALDataset::Open(path.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY | GDAL_OF_VERBOSE_ERROR));
  if (!dataset) {
    throw Error({.what = "the raster cannot be opened",
                 .where = path.string(),
                 .expected = "a complete raster file: " + readable_raster_formats(),
                 .found = QuietGdal::last_error(),
                 .fix = is_table_of_contents(path)
                            ? "name the frames of one scale, or a mosaic of them: gdalbuildvrt map.vrt FRAME…"
                            : "check the file with `gdalinfo`; download it again if it is truncated"});
  }
  list_files(path, *dataset, kMaxVrtDepth);
  return dataset;
}

std::vector<std::filesystem::path> files_of_raster(const std::filesystem::path& path) {
  if (mounted_object(path) != nullptr) return {path};
  if (is_zarr(path)) return files_of_zarr(path);
  if (is_stac_name(path.string())) return files_of_tiled_assets(path);
  const GdalHandle dataset = open_gdal_raster(path);
  return list_files(path, *dataset, kMaxVrtDepth);
}

GdalDataset::GdalDataset(const std::filesystem::path& path, std::optional<Stretch> stretch)
    : path_(path), object_(mounted_object(path)), dataset_(open_gdal_raster(path)), stretch_(stretch) {
  const QuietGdal quiet;
  size_ = {dataset_->GetRasterXSize(), dataset_->GetRasterYSize()};
  layout_ = find_band_layout(*dataset_, path_);
}

void GdalDataset::check(bool ok, const char* doing) const {
  if (object_ != nullptr) object_->require_sound();  // whatever GDAL made of it
  if (ok) return;
  throw Error({.what = fmt::format("the raster cannot be read while {}", doing),
               .where = path_.string(),
               .expected = "a complete file",
               .found = QuietGdal::last_error(),
               .fix = "download the file again; `gdalinfo -checksum` shows whether it is complete"});
}

cv::Mat GdalDataset::read_band(GDALRasterBand& band, int type, const cv::Rect& window, cv::Size size,
                               bool average) const {
  cv::Mat values(size, type);
  GDALRasterIOExtraArg extra;
  INIT_RASTERIO_EXTRA_ARG(extra);
  if (average) extra.eResampleAlg = GRIORA_Average;
  check(band.RasterIO(GF_Read, window.x, window.y, window.width, window.height, values.data, size.width, size.height,
                      type == CV_8UC1 ? GDT_Byte : GDT_UInt16, static_cast<GSpacing>(values.elemSize()),
                      static_cast<GSpacing>(values.step), &extra) == CE_None,
        "reading a band");
  return values;
}

// One channel for grey, else three. depth: CV_8U or CV_32F.
cv::Mat GdalDataset::read_colours(int depth, const cv::Rect& window, cv::Size size) const {
  const int count = layout_.grey() ? 1 : 3;
  cv::Mat values(size, CV_MAKETYPE(depth, count));
  std::array<int, 3> bands = layout_.bgr;
  GDALRasterIOExtraArg extra;
  INIT_RASTERIO_EXTRA_ARG(extra);
  extra.eResampleAlg = GRIORA_Average;
  check(dataset_->RasterIO(GF_Read, window.x, window.y, window.width, window.height, values.data, size.width,
                           size.height, depth == CV_8U ? GDT_Byte : GDT_Float32, count, bands.data(),
                           static_cast<GSpacing>(values.elemSize()), static_cast<GSpacing>(values.step),
                           static_cast<GSpacing>(values.elemSize1()), &extra) == CE_None,
        "reading its pixels");
  return values;
}

cv::Mat GdalDataset::read_validity(const cv::Rect& window, cv::Size size) const {
  const auto mask_of = [&](int band) {
    return read_band(*dataset_->GetRasterBand(band)->GetMaskBand(), CV_8UC1, window, size, true);
  };
  switch (layout_.validity) {
    case BandLayout::Validity::all: break;
    case BandLayout::Validity::alpha: {
      const int type = layout_.alpha_half > 255 ? CV_16UC1 : CV_8UC1;
      return read_band(*dataset_->GetRasterBand(layout_.alpha_band), type, window, size, true) >= layout_.alpha_half;
    }
    case BandLayout::Validity::mask: return mask_of(layout_.bgr[2]) >= 128;
    case BandLayout::Validity::nodata: {
      cv::Mat valid = mask_of(layout_.bgr[2]);
      if (!layout_.grey()) {
        for (const int band : {layout_.bgr[1], layout_.bgr[0]}) valid = cv::max(valid, mask_of(band));
      }
      return valid >= 128;
    }
  }
  return {size, CV_8UC1, cv::Scalar(255)};
}

// Palette indices cannot be averaged: nearest neighbour.
MaskedImage GdalDataset::read_palette(const cv::Rect& window, cv::Size size) const {
  const cv::Mat index = read_band(*dataset_->GetRasterBand(layout_.bgr[0]), CV_16UC1, window, size, false);
  MaskedImage image{cv::Mat(size, CV_8UC3), read_validity(window, size)};
  const cv::Mat& opaque = layout_.palette_mask;
  for (int row = 0; row < size.height; ++row) {
    const auto* in = index.ptr<std::uint16_t>(row);
    auto* colour = image.bgr.ptr<cv::Vec3b>(row);
    auto* valid = image.mask.ptr<std::uint8_t>(row);
    for (int column = 0; column < size.width; ++column) {
      const int entry = in[column];
      const bool known = entry < layout_.palette.cols;
      colour[column] = known ? layout_.palette.at<cv::Vec3b>(entry) : cv::Vec3b(0, 0, 0);
      if (!opaque.empty() && (!known || opaque.at<std::uint8_t>(entry) == 0)) valid[column] = 0;
    }
  }
  return image;
}

RasterSamples GdalDataset::read_samples(const cv::Rect& window, cv::Size size) const {
  const QuietGdal quiet;
  RasterSamples samples{read_colours(CV_32F, window, size), read_validity(window, size)};
  const int channels = samples.values.channels();
  for (int row = 0; row < size.height; ++row) {
    auto* value = samples.values.ptr<float>(row);
    auto* valid = samples.mask.ptr<std::uint8_t>(row);
    for (int i = 0; i < size.width * channels; ++i) {
      if (std::isfinite(value[i])) continue;
      valid[i / channels] = 0;
      value[i] = 0;
    }
  }
  return samples;
}

MaskedImage GdalDataset::read(const cv::Rect& window, cv::Size size) const {
  const QuietGdal quiet;
  if (!layout_.palette.empty()) return read_palette(window, size);
  MaskedImage image;
  cv::Mat colours;
  if (layout_.eight_bit) {
    colours = read_colours(CV_8U, window, size);
    image.mask = read_validity(window, size);
  } else {
    const RasterSamples samples = read_samples(window, size);
    colours = stretched(samples.values, stretch_.value());
    image.mask = samples.mask;
  }
  if (layout_.grey()) {
    cv::merge(std::vector<cv::Mat>{colours, colours, colours}, image.bgr);
  } else {
    image.bgr = colours;
  }
  return image;
}

}  // namespace nadir
