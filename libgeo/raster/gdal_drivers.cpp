#include "raster/gdal_drivers.hpp"

#include <cpl_conv.h>
#include <cpl_minixml.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gdal_priv.h>

#include <algorithm>
#include <array>
#include <memory>
#include <mutex>
#include <set>
#include <string_view>
#include <vector>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/input_file.hpp"
#include "base/printable.hpp"
#include "object_storage/object_address.hpp"
#include "raster/gdal_dataset.hpp"
#include "raster/tile_set_dataset.hpp"

namespace nadir {
namespace fs = std::filesystem;
namespace {

struct ReadableFormat {
  const char* driver;
  const char* shown;
};

constexpr std::array kRasterFormats{ReadableFormat{"GTiff", "GeoTIFF"},
                                    ReadableFormat{"VRT", "VRT"},
                                    ReadableFormat{"JP2OpenJPEG", "JPEG 2000"},
                                    ReadableFormat{"JPEG", "JPEG"},
                                    ReadableFormat{"PNG", "PNG"},
                                    ReadableFormat{"WEBP", "WebP"},
                                    ReadableFormat{"BMP", "BMP"},
                                    ReadableFormat{"HFA", "Erdas Imagine"},
                                    ReadableFormat{"ENVI", "ENVI"},
                                    ReadableFormat{"EHdr", "EHdr"},
                                    ReadableFormat{"AAIGrid", "Arc/Info ASCII grid"},
                                    ReadableFormat{"SRTMHGT", "SRTM HGT"},
                                    ReadableFormat{"DTED", "DTED"},
                                    ReadableFormat{"USGSDEM", "USGS DEM"},
                                    ReadableFormat{"NITF", "NITF"},
                                    ReadableFormat{"GPKG", "GeoPackage"},
                                    ReadableFormat{"MBTiles", "MBTiles"},
                                    ReadableFormat{"NadirPMTiles", "PMTiles"},
                                    ReadableFormat{"NadirTPKX", "Esri tile packages"},
                                    ReadableFormat{"Zarr", "Zarr"}};
constexpr std::array kVectorFormats{ReadableFormat{"GeoJSON", "GeoJSON"},
                                    ReadableFormat{"GeoJSONSeq", "GeoJSON lines"},
                                    ReadableFormat{"LIBKML", "KML"},
                                    ReadableFormat{"KML", "KML"},
                                    ReadableFormat{"GPKG", "GeoPackage"},
                                    ReadableFormat{"ESRI Shapefile", "Shapefile"},
                                    ReadableFormat{"FlatGeobuf", "FlatGeobuf"},
                                    ReadableFormat{"GPX", "GPX"},
                                    ReadableFormat{"MapInfo File", "MapInfo"}};
// Opened by name of the driver: the catalogue's own, and OpenStreetMap's for a package's vectors.
constexpr std::array kNamedDrivers{"SQLite", "PostgreSQL", "OSM"};

constexpr int kMaxNesting = 4;  // of VRTs in VRTs
constexpr std::uint64_t kMaxDescription_bytes = std::uint64_t{64} << 20;

bool may_open(std::string_view driver) {
  const auto is = [driver](const ReadableFormat& format) { return driver == format.driver; };
  return std::any_of(kRasterFormats.begin(), kRasterFormats.end(), is) ||
         std::any_of(kVectorFormats.begin(), kVectorFormats.end(), is) ||
         std::find(kNamedDrivers.begin(), kNamedDrivers.end(), driver) != kNamedDrivers.end();
}

template <typename Formats>
std::string shown(const Formats& formats) {
  std::vector<std::string_view> names;
  for (const ReadableFormat& format : formats) {
    if (names.empty() || names.back() != format.shown) names.emplace_back(format.shown);
  }
  return fmt::format("{}", fmt::join(names, ", "));
}

bool begins_as_vrt(const fs::path& file) {
  std::array<std::uint8_t, 64> head{};
  std::error_code code;
  if (!fs::is_regular_file(file, code)) return false;
  const InputFile input(file);
  const std::size_t size = std::min<std::uint64_t>(head.size(), input.size());
  if (!input.read_at(0, std::span(head).first(size))) return false;
  return std::string_view(reinterpret_cast<const char*>(head.data()), size).find("<VRT") != std::string_view::npos;
}

// What a VRT or the auxiliary file of a raster names, value by value.
class Description {
 public:
  explicit Description(const fs::path& raster) : raster_(raster) {}

  void check(const fs::path& file, int nesting) {
    if (nesting > kMaxNesting) reject_remote(raster_, fmt::format("VRTs nested more than {} deep", kMaxNesting));
    if (!seen_.insert(file.lexically_normal()).second) return;  // one that names itself would be read for ever
    const std::string text = read_text_file(file, kMaxDescription_bytes);
    const std::unique_ptr<CPLXMLNode, decltype(&CPLDestroyXMLNode)> tree(CPLParseXMLString(text.c_str()),
                                                                         &CPLDestroyXMLNode);
    walk(tree.get(), file, nesting);
  }

 private:
  // Brothers in a loop, children by recursion: CPLParseXMLString() bounds the depth.
  void walk(const CPLXMLNode* node, const fs::path& file, int nesting) {
    for (; node != nullptr; node = node->psNext) {
      if (node->eType == CXT_Text) value(node->pszValue, file, nesting);
      walk(node->psChild, file, nesting);
    }
  }

  void value(const std::string& text, const fs::path& file, int nesting) {
    if (text.find("/vsi") != std::string::npos) reject_remote(raster_, text.substr(0, 200));
    if (text.empty() || text.size() > 4096 || text.find('\n') != std::string::npos) return;
    const fs::path beside = file.parent_path() / text;
    if (begins_as_vrt(beside)) check(beside, nesting + 1);
  }

  const fs::path& raster_;
  std::set<fs::path> seen_;
};

}  // namespace

void reject_remote(const fs::path& path, const std::string& found) {
  throw UsageError({.what = "remote rasters are not read unless they are pinned",
                    .where = printable_url(path.string()),
                    .expected = "files on this machine, or a list of pinned objects",
                    .found = printable_url(found),
                    .fix = "pin it: nadir cache pin URL > sources.json, and name sources.json in its place"});
}

void register_gdal_drivers() {
  static std::once_flag once;
  std::call_once(once, [] {
    GDALAllRegister();
    register_tile_set_drivers();
    GDALDriverManager& drivers = *GetGDALDriverManager();
    for (int i = 0; i < drivers.GetDriverCount(); ++i) {
      GDALDriver& driver = *drivers.GetDriver(i);
      if (may_open(driver.GetDescription())) continue;
      driver.pfnOpen = nullptr;
      driver.pfnOpenWithDriverArg = nullptr;
    }
    // For what would reach /vsicurl/ and its kin all the same: only a file of this name, which is none.
    CPLSetConfigOption("CPL_VSIL_CURL_ALLOWED_FILENAME", "none");
    CPLSetConfigOption("GDAL_VRT_ENABLE_PYTHON", "NO");
    // Pixels that libjpeg invents for a damaged JPEG must not become a map.
    CPLSetConfigOption("GDAL_ERROR_ON_LIBJPEG_WARNING", "TRUE");
    // The default is 5 % of the machine's memory; a build's memory use must not depend on the machine.
    GDALSetCacheMax64(GIntBig{256} << 20);
  });
}

std::string readable_raster_formats() { return shown(kRasterFormats) + ", STAC tiled assets"; }
std::string readable_vector_formats() { return shown(kVectorFormats); }

GDALDriver& vector_writer(const std::string& driver, const fs::path& out) {
  register_gdal_drivers();
  if (GDALDriver* found = GetGDALDriverManager()->GetDriverByName(driver.c_str())) return *found;
  throw Error({.what = "this GDAL cannot write " + driver,
               .where = out.string(),
               .expected = "a GDAL with the driver " + driver + " (Parquet: built with Apache Arrow, or its plug-in)",
               .found = std::string("GDAL ") + GDALVersionInfo("RELEASE_NAME") + " without it, as Debian 12 has it",
               .fix =
                   "export as gpkg, and convert on a machine with such a GDAL: ogr2ogr -f Parquet OUT.parquet IN.gpkg "
                   "LAYER"});
}

void refuse_remote_raster(const fs::path& path) {
  const QuietGdal quiet;  // GDAL's XML parser writes to stderr
  if (is_remote_name(path.string())) reject_remote(path, path.string());
  if (begins_as_vrt(path)) Description(path).check(path, 0);
  fs::path beside = path;
  beside += ".aux.xml";
  std::error_code code;
  if (fs::is_regular_file(beside, code)) Description(path).check(beside, 0);
}

}  // namespace nadir
