#include "raster/tile_set_dataset.hpp"

#include <gdal_priv.h>

#include <algorithm>
#include <array>
#include <climits>
#include <cstring>
#include <memory>

#include "base/error.hpp"
#include "imagery/pmtiles.hpp"
#include "raster/tile_package.hpp"

namespace nadir {
namespace {

constexpr int kBands = 4;  // red, green, blue, alpha
constexpr std::array kColours{GCI_RedBand, GCI_GreenBand, GCI_BlueBand, GCI_AlphaBand};

class TileSetDataset final : public GDALDataset {
 public:
  // keys: of the finest zoom at least.
  TileSetDataset(std::unique_ptr<TileSource> tiles, const std::vector<TileKey>& keys);

  CPLErr GetGeoTransform(double* transform) override {
    const double pixel_m = mercator_pixel_m(zoom_) * kTileSize / side_;
    const double tile_m = pixel_m * side_;
    const std::array values{west_ * tile_m - kMercatorHalfWorld_m,  pixel_m, 0.0,
                            kMercatorHalfWorld_m - north_ * tile_m, 0.0,     -pixel_m};
    std::copy(values.begin(), values.end(), transform);
    return CE_None;
  }
  const OGRSpatialReference* GetSpatialRef() const override { return &system_; }

  // A tile as four planes of side x side bytes, one after the other.
  CPLErr read_tile(int column, int row, std::vector<std::uint8_t>& planes) const;
  int side() const { return side_; }

 private:
  std::unique_ptr<TileSource> tiles_;
  OGRSpatialReference system_;
  int zoom_;
  int side_ = kTileSize;
  std::uint32_t west_ = 0, north_ = 0;
};

class TileSetBand final : public GDALRasterBand {
 public:
  TileSetBand(TileSetDataset& dataset, int number) {
    poDS = &dataset;
    nBand = number;
    eDataType = GDT_Byte;
    nBlockXSize = nBlockYSize = dataset.side();
  }
  GDALColorInterp GetColorInterpretation() override { return kColours[static_cast<std::size_t>(nBand - 1)]; }

 private:
  // The other bands' blocks come with it: a tile is decoded once.
  CPLErr IReadBlock(int column, int row, void* target) override {
    const auto& dataset = *static_cast<TileSetDataset*>(poDS);
    std::vector<std::uint8_t> planes;
    if (const CPLErr error = dataset.read_tile(column, row, planes); error != CE_None) return error;
    const std::size_t size = static_cast<std::size_t>(nBlockXSize) * static_cast<std::size_t>(nBlockYSize);
    for (int band = 1; band <= kBands; ++band) {
      const std::uint8_t* plane = planes.data() + static_cast<std::size_t>(band - 1) * size;
      if (band == nBand) {
        std::memcpy(target, plane, size);
        continue;
      }
      GDALRasterBlock* block = poDS->GetRasterBand(band)->GetLockedBlockRef(column, row, TRUE);
      if (block == nullptr) return CE_Failure;
      std::memcpy(block->GetDataRef(), plane, size);
      block->DropLock();
    }
    return CE_None;
  }
};

TileSetDataset::TileSetDataset(std::unique_ptr<TileSource> tiles, const std::vector<TileKey>& keys)
    : tiles_(std::move(tiles)), zoom_(tiles_->zooms().max) {
  std::uint32_t east = 0, south = 0;
  west_ = north_ = ~0U;
  std::optional<TileKey> first;
  for (const TileKey& key : keys) {
    if (key.z != zoom_) continue;
    if (!first) first = key;
    west_ = std::min(west_, key.x), east = std::max(east, key.x);
    north_ = std::min(north_, key.y), south = std::max(south, key.y);
  }
  if (!first) throw Error({.what = "this tile set is empty"});
  const ImageInfo info = read_image_info(tiles_->read(*first).value(), "tile " + to_text(*first));
  side_ = info.width;
  const std::int64_t width = (std::int64_t{east} - west_ + 1) * side_,
                     height = (std::int64_t{south} - north_ + 1) * side_;
  if (info.width != info.height || (side_ != kTileSize && side_ != 2 * kTileSize) || width > INT_MAX ||
      height > INT_MAX) {
    throw Error({.what = "these tiles cannot be read as one raster",
                 .expected = "square tiles of 256 or 512 pixels, of an area that is not the whole world",
                 .found = std::to_string(info.width) + " x " + std::to_string(info.height) + " pixels"});
  }
  nRasterXSize = static_cast<int>(width), nRasterYSize = static_cast<int>(height);
  system_.importFromEPSG(3857);
  system_.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  for (int band = 1; band <= kBands; ++band) SetBand(band, new TileSetBand(*this, band));  // the dataset's from now on
}

CPLErr TileSetDataset::read_tile(int column, int row, std::vector<std::uint8_t>& planes) const {
  const std::size_t size = static_cast<std::size_t>(side_) * static_cast<std::size_t>(side_);
  planes.assign(kBands * size, 0);
  const TileKey key{static_cast<std::uint8_t>(zoom_), west_ + static_cast<std::uint32_t>(column),
                    north_ + static_cast<std::uint32_t>(row)};
  try {
    const std::optional<Bytes> bytes = tiles_->read(key);
    if (!bytes) return CE_None;
    const DecodedImage tile = decode_image(*bytes, Colour::bgr, "tile " + to_text(key));
    if (tile.image.cols != side_ || tile.image.rows != side_) {
      CPLError(CE_Failure, CPLE_AppDefined, "tile %s has %d x %d pixels, others %d", to_text(key).c_str(),
               tile.image.cols, tile.image.rows, side_);
      return CE_Failure;
    }
    for (int y = 0; y < side_; ++y) {
      const auto* bgr = tile.image.ptr<std::uint8_t>(y);
      const auto* alpha = tile.alpha.empty() ? nullptr : tile.alpha.ptr<std::uint8_t>(y);
      std::uint8_t* out = planes.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(side_);
      for (std::size_t x = 0; x < static_cast<std::size_t>(side_); ++x) {
        for (std::size_t colour = 0; colour < 3; ++colour) out[colour * size + x] = bgr[3 * x + 2 - colour];
        out[3 * size + x] = alpha == nullptr ? 255 : alpha[x];
      }
    }
    return CE_None;
  } catch (const std::exception& error) {  // nothing may be thrown through GDAL
    CPLError(CE_Failure, CPLE_AppDefined, "%s", error.what());
    return CE_Failure;
  }
}

std::string_view head_of(const GDALOpenInfo& info) {
  return {reinterpret_cast<const char*>(info.pabyHeader), static_cast<std::size_t>(info.nHeaderBytes)};
}

int is_pmtiles(GDALOpenInfo* info) { return head_of(*info).starts_with(kPmtilesMagic) ? TRUE : FALSE; }
int is_zip(GDALOpenInfo* info) { return head_of(*info).starts_with(kZipMagic) ? TRUE : FALSE; }

template <typename Reader>
GDALDataset* open(GDALOpenInfo* info) {
  if (info->eAccess != GA_ReadOnly) return nullptr;
  try {
    auto reader = std::make_unique<Reader>(InputFile(info->pszFilename));
    const std::vector<TileKey> keys = reader->keys();
    auto dataset = std::make_unique<TileSetDataset>(std::move(reader), keys);
    dataset->SetDescription(info->pszFilename);
    return dataset.release();
  } catch (const std::exception& error) {
    CPLError(CE_Failure, CPLE_OpenFailed, "%s", error.what());
    return nullptr;
  }
}

using Identify = int (*)(GDALOpenInfo*);

template <typename Reader, Identify identify>
void register_driver(const char* name, const char* long_name) {
  auto driver = std::make_unique<GDALDriver>();
  driver->SetDescription(name);
  driver->SetMetadataItem(GDAL_DCAP_RASTER, "YES");
  driver->SetMetadataItem(GDAL_DMD_LONGNAME, long_name);
  driver->pfnIdentify = identify;
  driver->pfnOpen = [](GDALOpenInfo* info) { return identify(info) == FALSE ? nullptr : open<Reader>(info); };
  GetGDALDriverManager()->RegisterDriver(driver.release());  // which owns it
}

}  // namespace

void register_tile_set_drivers() {
  register_driver<PmtilesReader, is_pmtiles>("NadirPMTiles", "PMTiles, raster");
  register_driver<TilePackageReader, is_zip>("NadirTPKX", "Esri tile package");
}

}  // namespace nadir
