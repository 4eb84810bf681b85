#include "raster/pmtiles_dataset.hpp"

#include <gdal_priv.h>

#include <algorithm>
#include <array>
#include <climits>
#include <cstring>
#include <memory>

#include "base/error.hpp"
#include "imagery/pmtiles.hpp"

namespace nadir {
namespace {

constexpr int kBands = 4;  // red, green, blue, alpha
constexpr std::array kColours{GCI_RedBand, GCI_GreenBand, GCI_BlueBand, GCI_AlphaBand};

class PmtilesDataset final : public GDALDataset {
 public:
  explicit PmtilesDataset(InputFile file);

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
  PmtilesReader reader_;
  OGRSpatialReference system_;
  int zoom_ = 0, side_ = kTileSize;
  std::uint32_t west_ = 0, north_ = 0;
};

class PmtilesBand final : public GDALRasterBand {
 public:
  PmtilesBand(PmtilesDataset& dataset, int number) {
    poDS = &dataset;
    nBand = number;
    eDataType = GDT_Byte;
    nBlockXSize = nBlockYSize = dataset.side();
  }
  GDALColorInterp GetColorInterpretation() override { return kColours[static_cast<std::size_t>(nBand - 1)]; }

 private:
  // The other bands' blocks come with it: a tile is decoded once.
  CPLErr IReadBlock(int column, int row, void* target) override {
    const auto& dataset = *static_cast<PmtilesDataset*>(poDS);
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

PmtilesDataset::PmtilesDataset(InputFile file) : reader_(std::move(file)) {
  zoom_ = reader_.zooms().max;
  std::uint32_t east = 0, south = 0;
  west_ = north_ = ~0U;
  std::optional<TileKey> first;
  for (const TileKey& key : reader_.keys()) {
    if (key.z != zoom_) continue;
    if (!first) first = key;
    west_ = std::min(west_, key.x), east = std::max(east, key.x);
    north_ = std::min(north_, key.y), south = std::max(south, key.y);
  }
  const ImageInfo info = read_image_info(*reader_.read(*first), "tile " + to_text(*first));
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
  for (int band = 1; band <= kBands; ++band) SetBand(band, new PmtilesBand(*this, band));  // the dataset's from now on
}

CPLErr PmtilesDataset::read_tile(int column, int row, std::vector<std::uint8_t>& planes) const {
  const std::size_t size = static_cast<std::size_t>(side_) * static_cast<std::size_t>(side_);
  planes.assign(kBands * size, 0);
  const TileKey key{static_cast<std::uint8_t>(zoom_), west_ + static_cast<std::uint32_t>(column),
                    north_ + static_cast<std::uint32_t>(row)};
  try {
    const std::optional<Bytes> bytes = reader_.read(key);
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

int identify(GDALOpenInfo* info) {
  const std::string_view head(reinterpret_cast<const char*>(info->pabyHeader),
                              static_cast<std::size_t>(info->nHeaderBytes));
  return head.starts_with(kPmtilesMagic) ? TRUE : FALSE;
}

GDALDataset* open(GDALOpenInfo* info) {
  if (identify(info) == FALSE || info->eAccess != GA_ReadOnly) return nullptr;
  try {
    auto dataset = std::make_unique<PmtilesDataset>(InputFile(info->pszFilename));
    dataset->SetDescription(info->pszFilename);
    return dataset.release();
  } catch (const std::exception& error) {
    CPLError(CE_Failure, CPLE_OpenFailed, "%s", error.what());
    return nullptr;
  }
}

}  // namespace

void register_pmtiles_driver() {
  auto driver = std::make_unique<GDALDriver>();
  driver->SetDescription("NadirPMTiles");
  driver->SetMetadataItem(GDAL_DCAP_RASTER, "YES");
  driver->SetMetadataItem(GDAL_DMD_LONGNAME, "PMTiles, raster");
  driver->pfnIdentify = identify;
  driver->pfnOpen = open;
  GetGDALDriverManager()->RegisterDriver(driver.release());  // which owns it
}

}  // namespace nadir
