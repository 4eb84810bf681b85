#include "raster/tiled_assets.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gdal_priv.h>
#include <ogr_spatialref.h>

#include <algorithm>
#include <array>
#include <climits>
#include <cmath>
#include <list>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/json.hpp"
#include "object_storage/object_address.hpp"
#include "raster/stac.hpp"

namespace nadir {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr std::uint64_t kMaxItem_bytes = std::uint64_t{64} << 20;
constexpr int kItemDepth = 32;  // of nested JSON
constexpr int kMaxTileSide_px = 65536;
constexpr std::int64_t kMaxTileSpan = 1'000'000;               // that a tile matrix's limits span
constexpr double kStandardPixel_m = 0.28e-3;                   // of the OGC's scale denominators
constexpr std::size_t kOpenTiles = 4;                          // of a dataset, which reads a window at a time
constexpr std::int64_t kWholeTile_px = std::int64_t{1} << 20;  // up to here a tile is read at once
constexpr double kSamePlace = 0.1;                             // of a pixel

void replace_all(std::string& text, std::string_view what, std::string_view with) {
  for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + with.size())) {
    text.replace(at, what.size(), with);
  }
}

// One of the grids of a tile matrix set, with the part of it that the item has.
struct TileMatrix {
  std::string id;
  double scale_denominator = 0;
  double west = 0, north = 0;  // of the tile with row and column 0, in units of the coordinate system
  int tile_width_px = 0, tile_height_px = 0;
  int first_column = 0, last_column = 0, first_row = 0, last_row = 0;

  std::int64_t columns() const { return std::int64_t{last_column} - first_column + 1; }
  std::int64_t rows() const { return std::int64_t{last_row} - first_row + 1; }
  std::int64_t tiles() const { return columns() * rows(); }
};

// What an item says of its tiles: where they are, and on the map.
class TiledItem {
 public:
  explicit TiledItem(const fs::path& item) : item_(item) {
    const json document = parse_json(read_text_file(item, kMaxItem_bytes), item.string(), {.max_depth = kItemDepth});
    const JsonReader in(document,
                        {.name = item.string(),
                         .what = "these tiled assets cannot be read as one raster",
                         .fix = "make a GeoTIFF of them: gdal_translate -of COG 'STACTA:\"ITEM.json\"' OUT.tif"});
    in.expect("type", "Feature");
    const JsonReader templates = in.object("asset_templates");
    const JsonReader properties = in.object("properties");
    const JsonReader sets = properties.object("tiles:tile_matrix_sets");
    const std::vector<std::string> names = sets.keys();
    if (names.size() != 1) sets.refuse("one tile matrix set");
    take_template(templates.object(imagery_asset_key(templates)), names.front());
    take_matrices(sets.object(names.front()), properties, names.front());
    take_finest(in);
  }

  const fs::path& item() const { return item_; }
  const TileMatrix& matrix() const { return matrix_; }
  const OGRSpatialReference& system() const { return system_; }
  double pixel() const { return matrix_.scale_denominator * kStandardPixel_m / metres_per_unit_; }

  fs::path tile(std::int64_t index) const { return tile_of(matrix_, index); }
  bool is_there(std::int64_t index) const { return there_[static_cast<std::size_t>(index)]; }
  std::int64_t first() const { return std::find(there_.begin(), there_.end(), true) - there_.begin(); }

 private:
  void take_template(const JsonReader& asset, const std::string& set) {
    href_ = asset.text("href", {.least = 1, .most = 4096});
    if (href_.starts_with("file://")) href_ = href_.substr(7);
    if (is_remote_name(href_)) asset.refuse("href", "files on this machine: tiles of a server are not pinned");
    replace_all(href_, "{TileMatrixSet}", set);
    std::string rest = href_;
    for (const std::string_view known : {"{TileMatrix}", "{TileRow}", "{TileCol}"}) replace_all(rest, known, "");
    if (rest.find('{') != std::string::npos) {
      asset.refuse("href", "no other parameters than {TileMatrixSet}, {TileMatrix}, {TileRow} and {TileCol}");
    }
  }

  void take_system(const JsonReader& set, const char* key) {
    const std::string& name = set.text(key, {.least = 1, .most = 4096});
    if (system_.SetFromUserInput(name.c_str(), OGRSpatialReference::SET_FROM_USER_INPUT_LIMITATIONS_get()) !=
        OGRERR_NONE) {
      set.refuse(key, "a coordinate reference system that PROJ knows");
    }
    // A corner is given in the system's own order of axes, by the standard; by programs, often, east before north.
    OGRAxisOrientation first = OAO_Other;
    system_.GetAxis(nullptr, 0, &first);
    if (first != OAO_East) {
      set.refuse(key,
                 "a system whose first axis points east (OGC:CRS84, not EPSG:4326): of others it is not certain "
                 "which number of a corner comes first");
    }
    system_.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
    metres_per_unit_ =
        system_.IsGeographic() != 0 ? system_.GetSemiMajor() * std::numbers::pi / 180 : system_.GetLinearUnits();
    if (!(metres_per_unit_ > 0)) set.refuse(key, "a system with a unit of length");
  }

  // Version 1 of the standard, or 2, which has other names for the same.
  void take_matrices(const JsonReader& set, const JsonReader& properties, const std::string& name) {
    const bool second = set.has("tileMatrices");
    take_system(set, second ? "crs" : "supportedCRS");
    const JsonReader list = set.array(second ? "tileMatrices" : "tileMatrix", {.least = 1, .most = 100});
    const std::optional<JsonReader> links = links_of(properties);
    const std::optional<JsonReader> link = links ? links->optional_object(name) : std::nullopt;
    const std::optional<JsonReader> limits = link ? link->optional_object("limits") : std::nullopt;
    const std::optional<JsonReader> buffers = link ? link->optional_object("pixel_buffer") : std::nullopt;
    for (std::size_t i = 0; i < list.size(); ++i) {
      const JsonReader in = list.object(i);
      TileMatrix matrix{.id = in.text(second ? "id" : "identifier", {.least = 1, .most = 256}),
                        .scale_denominator = in.number("scaleDenominator", 1e-3, 1e12),
                        .tile_width_px = in.integer<int>("tileWidth", 1, kMaxTileSide_px),
                        .tile_height_px = in.integer<int>("tileHeight", 1, kMaxTileSide_px),
                        .last_column = in.integer<int>("matrixWidth", 1, INT_MAX) - 1,
                        .last_row = in.integer<int>("matrixHeight", 1, INT_MAX) - 1};
      if (limits && !limits->has(matrix.id)) continue;
      if (second) {
        if (const auto corner = in.optional_text("cornerOfOrigin"); corner && *corner != "topLeft") {
          in.refuse("cornerOfOrigin", "topLeft");
        }
      }
      if (in.has(second ? "variableMatrixWidths" : "variableMatrixWidth")) in.refuse("rows of the same width");
      if (buffers && buffers->has(matrix.id)) buffers->refuse("tiles that do not overlap");
      const JsonReader corner = in.array(second ? "pointOfOrigin" : "topLeftCorner", {.least = 2, .most = 2});
      matrix.west = corner.number(0), matrix.north = corner.number(1);
      if (limits) take_limits(limits->object(matrix.id), matrix);
      matrices_.push_back(std::move(matrix));
    }
  }

  // The standard's name, and that of its examples.
  static std::optional<JsonReader> links_of(const JsonReader& properties) {
    if (properties.has("tiles:tile_matrix_set_links")) return properties.object("tiles:tile_matrix_set_links");
    return properties.optional_object("tiles:tile_matrix_links");
  }

  static void take_limits(const JsonReader& in, TileMatrix& matrix) {
    const auto narrow = [&in](const char* least, const char* most, int& first, int& last) {
      first = in.optional_integer<int>(least, first, last).value_or(first);
      last = in.optional_integer<int>(most, first, last).value_or(last);
    };
    narrow("min_tile_col", "max_tile_col", matrix.first_column, matrix.last_column);
    narrow("min_tile_row", "max_tile_row", matrix.first_row, matrix.last_row);
  }

  fs::path tile_of(const TileMatrix& matrix, std::int64_t index) const {
    std::string name = href_;
    replace_all(name, "{TileMatrix}", matrix.id);
    replace_all(name, "{TileRow}", std::to_string(matrix.first_row + index / matrix.columns()));
    replace_all(name, "{TileCol}", std::to_string(matrix.first_column + index % matrix.columns()));
    return (item_.parent_path() / name).lexically_normal();
  }

  // Matrices are planned before they are filled.
  void take_finest(const JsonReader& in) {
    const auto names = [this](std::string_view parameter) { return href_.find(parameter) != std::string::npos; };
    if (matrices_.size() > 1 && !names("{TileMatrix}")) {
      in.refuse("{TileMatrix} in the template, or limits of one tile matrix: whose tiles these are is not said");
    }
    std::stable_sort(matrices_.begin(), matrices_.end(), [](const TileMatrix& a, const TileMatrix& b) {
      return a.scale_denominator < b.scale_denominator;
    });
    for (const TileMatrix& matrix : matrices_) {
      if ((matrix.columns() > 1 && !names("{TileCol}")) || (matrix.rows() > 1 && !names("{TileRow}"))) {
        in.refuse("{TileRow} and {TileCol} in the template");
      }
      if (matrix.tiles() > kMaxTileSpan || matrix.columns() > INT_MAX / matrix.tile_width_px ||
          matrix.rows() > INT_MAX / matrix.tile_height_px) {
        in.refuse(fmt::format("limits of tile matrix {} that span at most {} tiles, found {} x {}", matrix.id,
                              kMaxTileSpan, matrix.columns(), matrix.rows()));
      }
      there_.assign(static_cast<std::size_t>(matrix.tiles()), false);
      std::error_code code;
      for (std::int64_t i = 0; i < matrix.tiles(); ++i) {
        there_[static_cast<std::size_t>(i)] = fs::is_regular_file(tile_of(matrix, i), code);
      }
      if (std::find(there_.begin(), there_.end(), true) == there_.end()) continue;
      matrix_ = matrix;
      return;
    }
    in.refuse(fmt::format("tiles where the template says, {}",
                          matrices_.empty() ? href_ : tile_of(matrices_.front(), 0).string()));
  }

  fs::path item_;
  std::string href_;
  OGRSpatialReference system_;
  double metres_per_unit_ = 1;
  std::vector<TileMatrix> matrices_;
  TileMatrix matrix_;
  std::vector<bool> there_;
};

// What all tiles have in common.
struct TileLook {
  int width_px = 0, height_px = 0;
  std::vector<GDALDataType> types;  // of the bands that are no alpha
  std::optional<double> nodata;
  bool palette = false;

  explicit TileLook(GDALDataset& tile) : width_px(tile.GetRasterXSize()), height_px(tile.GetRasterYSize()) {
    for (int band = 1; band <= tile.GetRasterCount(); ++band) {
      GDALRasterBand& one = *tile.GetRasterBand(band);
      if (one.GetColorInterpretation() == GCI_AlphaBand) continue;
      types.push_back(one.GetRasterDataType());
      palette = palette || one.GetColorTable() != nullptr;
      int there = 0;
      const double value = one.GetNoDataValue(&there);
      if (there != 0 && !nodata) nodata = value;
    }
  }

  std::string text() const {
    std::vector<const char*> names;
    for (const GDALDataType type : types) names.push_back(GDALGetDataTypeName(type));
    return fmt::format("{} x {} pixels of {}{}, {}", width_px, height_px, fmt::join(names, ", "),
                       palette ? " with a palette" : "", nodata ? fmt::format("nodata {}", *nodata) : "no nodata");
  }
};

GdalHandle open_tile(const fs::path& path) {
  static constexpr std::array kDrivers = {"GTiff", "JPEG",        "PNG",
                                          "WEBP",  "JP2OpenJPEG", static_cast<const char*>(nullptr)};
  // World files and .aux.xml are not looked for: whatever is read has a digest.
  static constexpr std::array kNothingBeside = {"", static_cast<const char*>(nullptr)};
  return GdalHandle(GDALDataset::Open(path.c_str(), GDAL_OF_RASTER | GDAL_OF_READONLY | GDAL_OF_VERBOSE_ERROR,
                                      kDrivers.data(), nullptr, kNothingBeside.data()));
}

class TiledDataset final : public GDALDataset {
 public:
  TiledDataset(TiledItem item, GDALDataset& first);

  CPLErr GetGeoTransform(double* transform) override {
    const std::array values = transform_of(0, 0);
    std::copy(values.begin(), values.end(), transform);
    return CE_None;
  }
  const OGRSpatialReference* GetSpatialRef() const override { return &item_.system(); }

  const TileLook& look() const { return look_; }
  cv::Size block() const { return block_; }

  // Of the number'th tile; null, with GDAL's error, when it cannot be read or is not like the first one.
  GDALDataset* opened(std::int64_t index);

  // A block of a band of the tiles (from 1), or of their validity (0).
  CPLErr read_block(int band, int column, int row, GDALDataType type, void* target);

 private:
  std::array<double, 6> transform_of(std::int64_t column, std::int64_t row) const {
    const TileMatrix& matrix = item_.matrix();
    const double pixel = item_.pixel();
    return {matrix.west + static_cast<double>((matrix.first_column + column) * matrix.tile_width_px) * pixel,
            pixel,
            0,
            matrix.north - static_cast<double>((matrix.first_row + row) * matrix.tile_height_px) * pixel,
            0,
            -pixel};
  }
  bool fits(GDALDataset& tile, std::int64_t index) const;
  static CPLErr read_validity(GDALDataset& tile, const cv::Rect& window, GDALDataType type, void* target);

  TiledItem item_;
  TileLook look_;
  cv::Size block_;
  std::list<std::pair<std::int64_t, GdalHandle>> open_;  // the last used in front
};

class TiledBand final : public GDALRasterBand {
 public:
  // source: band of the tiles, 0 for their validity.
  TiledBand(TiledDataset& dataset, int number, int source, GDALDataType type, GDALColorInterp colour)
      : source_(source), colour_(colour) {
    poDS = &dataset;
    nBand = number;
    eDataType = type;
    nBlockXSize = dataset.block().width, nBlockYSize = dataset.block().height;
  }
  GDALColorInterp GetColorInterpretation() override { return colour_; }
  double GetNoDataValue(int* there) override {
    const std::optional<double>& nodata = static_cast<TiledDataset*>(poDS)->look().nodata;
    if (there != nullptr) *there = nodata ? TRUE : FALSE;
    return nodata.value_or(0);
  }

 private:
  CPLErr IReadBlock(int column, int row, void* target) override {
    return static_cast<TiledDataset*>(poDS)->read_block(source_, column, row, eDataType, target);
  }

  int source_;
  GDALColorInterp colour_;
};

TiledDataset::TiledDataset(TiledItem item, GDALDataset& first) : item_(std::move(item)), look_(first) {
  const TileMatrix& matrix = item_.matrix();
  nRasterXSize = static_cast<int>(matrix.columns() * matrix.tile_width_px);
  nRasterYSize = static_cast<int>(matrix.rows() * matrix.tile_height_px);
  // A block never lies in two tiles.
  first.GetRasterBand(1)->GetBlockSize(&block_.width, &block_.height);
  if (std::int64_t{matrix.tile_width_px} * matrix.tile_height_px <= kWholeTile_px) {
    block_ = {matrix.tile_width_px, matrix.tile_height_px};
  } else if (matrix.tile_width_px % block_.width != 0 || matrix.tile_height_px % block_.height != 0) {
    block_ = {matrix.tile_width_px, 1};
  }
  const auto add = [this](int source, GDALDataType type, GDALColorInterp colour) {
    const int number = GetRasterCount() + 1;
    SetBand(number, new TiledBand(*this, number, source, type, colour));  // the dataset's from now on
  };
  for (int source = 1; source <= first.GetRasterCount(); ++source) {
    GDALRasterBand& band = *first.GetRasterBand(source);
    const GDALColorInterp colour = band.GetColorInterpretation();
    if (colour != GCI_AlphaBand) add(source, band.GetRasterDataType(), colour);
  }
  if (!look_.nodata) add(0, GDT_Byte, GCI_AlphaBand);
}

bool TiledDataset::fits(GDALDataset& tile, std::int64_t index) const {
  const TileMatrix& matrix = item_.matrix();
  const std::string name = item_.tile(index).string();
  if (const std::string found = TileLook(tile).text(); found != look_.text()) {
    CPLError(CE_Failure, CPLE_AppDefined, "%s is not like the first tile: %s, expected %s", name.c_str(), found.c_str(),
             look_.text().c_str());
    return false;
  }
  std::array<double, 6> stated{};
  if (tile.GetGeoTransform(stated.data()) != CE_None) return true;
  const auto expected = transform_of(index % matrix.columns(), index / matrix.columns());
  const double pixel = item_.pixel();
  const auto far = [pixel](double a, double b, double pixels) {
    return !(std::abs(a - b) * pixels < kSamePlace * pixel);
  };
  static constexpr std::array kLenient = {"IGNORE_DATA_AXIS_TO_SRS_AXIS_MAPPING=YES",
                                          "CRITERION=EQUIVALENT_EXCEPT_AXIS_ORDER_GEOGCRS",
                                          static_cast<const char*>(nullptr)};
  const OGRSpatialReference* system = tile.GetSpatialRef();
  if (system != nullptr && system->IsSame(&item_.system(), kLenient.data()) == 0) {
    CPLError(CE_Failure, CPLE_AppDefined, "%s states another coordinate system, %s", name.c_str(), system->GetName());
    return false;
  }
  if (far(stated[0], expected[0], 1) || far(stated[3], expected[3], 1) ||
      far(stated[1], expected[1], matrix.tile_width_px) || far(stated[5], expected[5], matrix.tile_height_px) ||
      stated[2] != 0 || stated[4] != 0) {
    CPLError(CE_Failure, CPLE_AppDefined, "%s lies at %.9g, %.9g by its own statement, at %.9g, %.9g by its number",
             name.c_str(), stated[0], stated[3], expected[0], expected[3]);
    return false;
  }
  return true;
}

GDALDataset* TiledDataset::opened(std::int64_t index) {
  const auto found = std::find_if(open_.begin(), open_.end(), [index](const auto& one) { return one.first == index; });
  if (found != open_.end()) {
    open_.splice(open_.begin(), open_, found);
    return open_.front().second.get();
  }
  GdalHandle tile = open_tile(item_.tile(index));
  if (!tile || !fits(*tile, index)) return nullptr;
  if (open_.size() >= kOpenTiles) open_.pop_back();
  open_.emplace_front(index, std::move(tile));
  return open_.front().second.get();
}

// Without nodata all bands have the same mask: the tile's own, or its alpha.
CPLErr TiledDataset::read_validity(GDALDataset& tile, const cv::Rect& window, GDALDataType type, void* target) {
  return tile.GetRasterBand(1)->GetMaskBand()->RasterIO(GF_Read, window.x, window.y, window.width, window.height,
                                                        target, window.width, window.height, type, 0, 0, nullptr);
}

CPLErr TiledDataset::read_block(int band, int column, int row, GDALDataType type, void* target) {
  const TileMatrix& matrix = item_.matrix();
  const std::int64_t x = std::int64_t{column} * block_.width, y = std::int64_t{row} * block_.height;
  const std::int64_t index = y / matrix.tile_height_px * matrix.columns() + x / matrix.tile_width_px;
  const cv::Rect window(static_cast<int>(x % matrix.tile_width_px), static_cast<int>(y % matrix.tile_height_px),
                        block_.width, block_.height);
  if (!item_.is_there(index)) {
    const double nothing = look_.nodata.value_or(0);
    const int size = GDALGetDataTypeSizeBytes(type);
    GDALCopyWords64(&nothing, GDT_Float64, 0, target, type, size, std::int64_t{block_.width} * block_.height);
    return CE_None;
  }
  GDALDataset* tile = opened(index);
  if (tile == nullptr) return CE_Failure;
  if (band == 0) return read_validity(*tile, window, type, target);
  return tile->GetRasterBand(band)->RasterIO(GF_Read, window.x, window.y, window.width, window.height, target,
                                             window.width, window.height, type, 0, 0, nullptr);
}

}  // namespace

GdalHandle open_tiled_assets(const fs::path& item) {
  const QuietGdal quiet;
  TiledItem tiles(item);
  const fs::path path = tiles.tile(tiles.first());
  const auto refuse = [&path](std::string expected, std::string found) {
    throw Error({.what = "a tile of tiled assets cannot be read",
                 .where = path.string(),
                 .expected = std::move(expected),
                 .found = std::move(found),
                 .fix = "check the file with `gdalinfo`; copy the tiles again if it is truncated"});
  };
  const GdalHandle first = open_tile(path);
  if (!first) refuse("GeoTIFF, JPEG, PNG, WebP or JPEG 2000", QuietGdal::last_error());
  const TileMatrix& matrix = tiles.matrix();
  const TileLook look(*first);
  if (look.types.empty() || look.width_px != matrix.tile_width_px || look.height_px != matrix.tile_height_px) {
    refuse(fmt::format("{} x {} pixels, as the tile matrix says", matrix.tile_width_px, matrix.tile_height_px),
           look.text());
  }
  if (look.palette) refuse("grey or colours", "a palette, which every tile may have of its own");
  const std::int64_t index = tiles.first();
  auto dataset = std::make_unique<TiledDataset>(std::move(tiles), *first);
  dataset->SetDescription(item.c_str());
  if (dataset->opened(index) == nullptr) refuse("a tile that lies where its number says", QuietGdal::last_error());
  return GdalHandle(dataset.release());
}

std::vector<fs::path> files_of_tiled_assets(const fs::path& item) {
  const QuietGdal quiet;
  const TiledItem tiles(item);
  std::vector<fs::path> files{item};
  for (std::int64_t i = 0; i < tiles.matrix().tiles(); ++i) {
    if (tiles.is_there(i)) files.push_back(tiles.tile(i));
  }
  return files;
}

}  // namespace nadir
