#include "ground/gdal_dataset.hpp"

#include <cpl_conv.h>
#include <fmt/format.h>
#include <gdal_priv.h>

#include <mutex>
#include <opencv2/core.hpp>
#include <set>

#include "base/error.hpp"

namespace nadir {
namespace {

void register_drivers() {
  static std::once_flag once;
  std::call_once(once, [] {
    GDALAllRegister();
    // Made-up pixels of a damaged JPEG must not become a map.
    CPLSetConfigOption("GDAL_ERROR_ON_LIBJPEG_WARNING", "TRUE");
    // The default is 5 % of the machine's memory; a build's memory shall not depend on the machine.
    GDALSetCacheMax64(GIntBig{256} << 20);
  });
}

constexpr int kNestedVrts = 4;

// What is built shall depend on files alone, which can be digested and are the same tomorrow.
bool is_remote(const std::string& name) {
  if (name.starts_with("/vsi")) return true;
  const std::size_t colon = name.find("://");
  return colon != std::string::npos && colon < 10;
}

[[noreturn]] void refuse_remote(const std::filesystem::path& path, const std::string& found) {
  throw UsageError({.what = "remote imagery is not read",
                    .where = path.string(),
                    .expected = "files on this machine",
                    .found = found,
                    .fix = "fetch it first, for example with gdal_translate, then give the file"});
}

// Throws UsageError when one of them is remote.
std::vector<std::filesystem::path> list_files(const std::filesystem::path& path, GDALDataset& dataset, int depth) {
  std::vector<std::filesystem::path> files;
  const std::unique_ptr<char*, decltype(&CSLDestroy)> list(dataset.GetFileList(), &CSLDestroy);
  for (int i = 0; i < CSLCount(list.get()); ++i) {
    const std::string name = list.get()[i];
    if (is_remote(name)) refuse_remote(path, name);
    if (!std::filesystem::is_regular_file(name)) continue;
    files.emplace_back(name);
    if (depth == 0 || i == 0 || files.back().extension() != ".vrt") continue;
    const GdalHandle nested(GDALDataset::Open(name.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY));
    if (!nested) continue;
    for (auto& file : list_files(path, *nested, depth - 1)) files.push_back(std::move(file));
  }
  return files;
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

GdalHandle open_gdal_raster(const std::filesystem::path& path) {
  const QuietGdal quiet;
  register_drivers();
  if (is_remote(path.string())) refuse_remote(path, path.string());
  if (!std::filesystem::is_regular_file(path)) {
    throw Error({.what = std::filesystem::exists(path) ? "the raster is not a file" : "the raster does not exist",
                 .where = path.string(),
                 .fix = "check the path"});
  }
  GdalHandle dataset(GDALDataset::Open(path.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY | GDAL_OF_VERBOSE_ERROR));
  if (!dataset) {
    throw Error({.what = "the raster cannot be opened",
                 .where = path.string(),
                 .expected = "a raster file that GDAL reads, whole",
                 .found = QuietGdal::last_error(),
                 .fix = "see what `gdalinfo` says about the file; fetch it again if it is truncated"});
  }
  const std::string driver = dataset->GetDriverName();
  if (const std::set<std::string> services = {"WMS", "WMTS", "WCS", "HTTP", "OGCAPI", "EEDAI", "PLMOSAIC", "DAAS",
                                              "NGW"};
      services.contains(driver)) {
    refuse_remote(path, "a description of a service (" + driver + ")");
  }
  list_files(path, *dataset, kNestedVrts);
  return dataset;
}

std::vector<std::filesystem::path> files_of_raster(const std::filesystem::path& path) {
  const GdalHandle dataset = open_gdal_raster(path);
  return list_files(path, *dataset, kNestedVrts);
}

GdalDataset::GdalDataset(const std::filesystem::path& path) : path_(path), dataset_(open_gdal_raster(path)) {
  const QuietGdal quiet;
  size_ = {dataset_->GetRasterXSize(), dataset_->GetRasterYSize()};
  find_layout();
}

void GdalDataset::find_layout() {
  const int bands = dataset_->GetRasterCount();
  for (int i = 1; i <= std::min(bands, 4); ++i) {
    const GDALDataType type = dataset_->GetRasterBand(i)->GetRasterDataType();
    if (type == GDT_Byte) continue;
    throw UsageError({.what = "the raster is not 8 bit",
                      .where = fmt::format("{} (band {})", path_.string(), i),
                      .expected = "bands of type Byte",
                      .found = GDALGetDataTypeName(type),
                      .fix = "convert it: gdal_translate -ot Byte -scale IN.tif OUT.tif"});
  }
  if (bands < 1) throw UsageError({.what = "the raster has no bands", .where = path_.string()});

  GDALRasterBand* first = dataset_->GetRasterBand(1);
  const bool colour = bands >= 3;
  if (colour) {
    bgr_bands_ = {3, 2, 1};
  } else {
    bgr_bands_ = {1, 1, 1};
  }
  if (const GDALColorTable* table = first->GetColorTable(); table != nullptr && !colour) {
    palette_ = cv::Mat::zeros(1, 256, CV_8UC3);
    palette_mask_ = cv::Mat::zeros(1, 256, CV_8UC1);
    for (int i = 0; i < std::min(256, table->GetColorEntryCount()); ++i) {
      GDALColorEntry entry;
      table->GetColorEntryAsRGB(i, &entry);
      palette_.at<cv::Vec3b>(i) = {static_cast<std::uint8_t>(entry.c3), static_cast<std::uint8_t>(entry.c2),
                                   static_cast<std::uint8_t>(entry.c1)};
      palette_mask_.at<std::uint8_t>(i) = entry.c4 >= 128 ? 255 : 0;
    }
  }
  const int flags = first->GetMaskFlags();
  if ((flags & GMF_ALL_VALID) != 0) {
    validity_ = Validity::all;
  } else if ((flags & GMF_NODATA) != 0) {
    validity_ = Validity::nodata;
  } else {
    validity_ = Validity::mask;
  }
  if (!palette_mask_.empty() && cv::countNonZero(palette_mask_) < 256 && validity_ == Validity::all) {
    const int entries = std::min(256, first->GetColorTable()->GetColorEntryCount());
    if (cv::countNonZero(palette_mask_.colRange(0, entries)) == entries) palette_mask_.release();
  }
}

void GdalDataset::check(bool ok, const char* doing) const {
  if (ok) return;
  throw Error({.what = fmt::format("the raster cannot be read while {}", doing),
               .where = path_.string(),
               .expected = "a whole file",
               .found = QuietGdal::last_error(),
               .fix = "fetch the file again; `gdalinfo -checksum` shows whether it is whole"});
}

cv::Mat GdalDataset::read_mask(int band, const cv::Rect& window, cv::Size size) const {
  cv::Mat mask(size, CV_8UC1);
  GDALRasterIOExtraArg extra;
  INIT_RASTERIO_EXTRA_ARG(extra);
  extra.eResampleAlg = GRIORA_Average;
  const CPLErr code = dataset_->GetRasterBand(band)->GetMaskBand()->RasterIO(
      GF_Read, window.x, window.y, window.width, window.height, mask.data, size.width, size.height, GDT_Byte, 1,
      static_cast<GSpacing>(mask.step), &extra);
  check(code == CE_None, "reading its mask");
  return mask;
}

Picture GdalDataset::read(const cv::Rect& window, cv::Size size) const {
  const QuietGdal quiet;
  Picture picture;
  picture.bgr.create(size, CV_8UC3);
  GDALRasterIOExtraArg extra;
  INIT_RASTERIO_EXTRA_ARG(extra);
  if (!palette_.empty()) {
    // Colours can be averaged, their numbers cannot.
    cv::Mat index(size, CV_8UC1);
    check(dataset_->GetRasterBand(1)->RasterIO(GF_Read, window.x, window.y, window.width, window.height, index.data,
                                               size.width, size.height, GDT_Byte, 1, static_cast<GSpacing>(index.step),
                                               &extra) == CE_None,
          "reading its pixels");
    cv::Mat three;
    cv::merge(std::vector<cv::Mat>{index, index, index}, three);
    cv::LUT(three, palette_, picture.bgr);
    if (!palette_mask_.empty()) cv::LUT(index, palette_mask_, picture.mask);
  } else {
    extra.eResampleAlg = GRIORA_Average;
    const bool grey = bgr_bands_[0] == bgr_bands_[2];
    cv::Mat one;
    if (grey) one.create(size, CV_8UC1);
    cv::Mat& target = grey ? one : picture.bgr;
    const int count = grey ? 1 : 3;
    std::vector<int> bands = grey ? std::vector<int>{1} : bgr_bands_;
    check(dataset_->RasterIO(GF_Read, window.x, window.y, window.width, window.height, target.data, size.width,
                             size.height, GDT_Byte, count, bands.data(), count, static_cast<GSpacing>(target.step), 1,
                             &extra) == CE_None,
          "reading its pixels");
    if (grey) cv::merge(std::vector<cv::Mat>{one, one, one}, picture.bgr);
  }

  if (validity_ == Validity::all) {
    if (picture.mask.empty()) picture.mask = cv::Mat(size, CV_8UC1, cv::Scalar(255));
    return picture;
  }
  cv::Mat valid = read_mask(1, window, size);
  if (validity_ == Validity::nodata && bgr_bands_[0] != bgr_bands_[2]) {
    for (const int band : {2, 3}) valid = cv::max(valid, read_mask(band, window, size));
  }
  valid = valid >= 128;
  picture.mask = picture.mask.empty() ? valid : cv::Mat(picture.mask & valid);
  return picture;
}

}  // namespace nadir
