#include "imagery/matchability_raster.hpp"

#include <fmt/format.h>
#include <tiffio.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "base/error.hpp"
#include "imagery/tiff_memory.hpp"

namespace nadir {
namespace {

constexpr std::uint32_t kTagScale = 33550, kTagTie = 33922, kTagMatrix = 34264, kTagKeys = 34735;
constexpr std::uint16_t kBands = 6, kClassBand = 3;
constexpr tmsize_t kMaxStrip = tmsize_t{8} << 20;  // a strip holds all cells at most
constexpr double kWorld_m = 20037508.342789244;    // half of Web Mercator's side
constexpr double kLeastCell_m = 0.1;

class MatchabilityTiff {
 public:
  MatchabilityTiff(ByteView file, std::string_view name) : name_(name), memory_{file} {
    tiff_ = open_tiff(memory_, "matchability", kMaxStrip);
    if (!tiff_) refuse("a complete TIFF file", memory_.complaint);
  }

  MatchabilityRaster read() {
    check_layout();
    read_grid();
    read_classes();
    return MatchabilityRaster(std::move(cells_));
  }

 private:
  [[noreturn]] void refuse(std::string expected, std::string found) const {
    throw Error({.what = "this matchability map cannot be used",
                 .where = name_,
                 .expected = std::move(expected),
                 .found = found.empty() ? "something else" : std::move(found),
                 .fix = "make it again with `nadir cache matchability --into-package`"});
  }

  template <typename Value>
  Value tag(std::uint32_t tag) const {
    Value value = 0;
    return TIFFGetFieldDefaulted(tiff_.get(), tag, &value) == 1 ? value : Value{0};
  }

  void expect(const char* what, std::uint32_t found, std::initializer_list<std::uint32_t> allowed) const {
    if (std::find(allowed.begin(), allowed.end(), found) != allowed.end()) return;
    refuse(fmt::format("{} {}", what, *allowed.begin()), fmt::format("{} {}", what, found));
  }

  void check_layout() {
    if (TIFFLastDirectory(tiff_.get()) == 0) refuse("one image", "several");
    if (TIFFIsTiled(tiff_.get()) != 0) refuse("a file in strips", "a tiled one");
    expect("samples per pixel", tag<std::uint16_t>(TIFFTAG_SAMPLESPERPIXEL), {kBands});
    expect("bits per sample", tag<std::uint16_t>(TIFFTAG_BITSPERSAMPLE), {32});
    expect("sample format", tag<std::uint16_t>(TIFFTAG_SAMPLEFORMAT), {SAMPLEFORMAT_IEEEFP});
    expect("planar configuration", tag<std::uint16_t>(TIFFTAG_PLANARCONFIG), {PLANARCONFIG_SEPARATE});
    expect("compression", tag<std::uint16_t>(TIFFTAG_COMPRESSION),
           {COMPRESSION_ADOBE_DEFLATE, COMPRESSION_NONE, COMPRESSION_DEFLATE});
    const auto columns = tag<std::uint32_t>(TIFFTAG_IMAGEWIDTH), rows = tag<std::uint32_t>(TIFFTAG_IMAGELENGTH);
    if (columns < 1 || rows < 1 || std::uint64_t{columns} * rows > kMaxMatchabilityCells) {
      refuse(fmt::format("1 to {} cells", kMaxMatchabilityCells), fmt::format("{} x {}", columns, rows));
    }
    cells_.columns = static_cast<int>(columns);
    cells_.rows = static_cast<int>(rows);
  }

  void read_grid() {
    std::size_t scales = 0, ties = 0, other = 0, count = 0;
    const auto* scale = static_cast<const double*>(tiff_values(*tiff_, kTagScale, TIFF_DOUBLE, scales));
    const auto* tie = static_cast<const double*>(tiff_values(*tiff_, kTagTie, TIFF_DOUBLE, ties));
    if (tiff_values(*tiff_, kTagMatrix, TIFF_DOUBLE, other) != nullptr || scale == nullptr || scales != 3 ||
        tie == nullptr || ties != 6 || tie[0] != 0 || tie[1] != 0 || scale[0] != scale[1]) {
      refuse("square cells that lie north up: ModelPixelScale and one ModelTiepoint of pixel 0, 0",
             "another georeference");
    }
    constexpr std::uint16_t kRasterType = 1025, kProjection = 3072;
    const auto* keys = static_cast<const std::uint16_t*>(tiff_values(*tiff_, kTagKeys, TIFF_SHORT, count));
    std::uint16_t raster = 0, projection = 0;
    for (std::size_t i = 4; keys != nullptr && i + 3 < count; i += 4) {
      if (keys[i + 1] != 0) continue;
      if (keys[i] == kRasterType) raster = keys[i + 3];
      if (keys[i] == kProjection) projection = keys[i + 3];
    }
    if (raster != 1 || projection != 3857) {
      refuse("EPSG:3857, pixels as areas", fmt::format("projection {}, raster type {}", projection, raster));
    }
    cells_.north_west = {tie[3], tie[4]};
    cells_.side_m = scale[0];
  }

  void read_classes() {
    const auto columns = static_cast<std::size_t>(cells_.columns), rows = static_cast<std::size_t>(cells_.rows);
    std::vector<float> row(columns);
    if (static_cast<std::size_t>(TIFFScanlineSize(tiff_.get())) != columns * sizeof(float)) {
      refuse("rows of float32", "rows of another size");
    }
    cells_.classes.reserve(columns * rows);
    for (std::size_t r = 0; r < rows; ++r) {
      if (TIFFReadScanline(tiff_.get(), row.data(), static_cast<std::uint32_t>(r), kClassBand) != 1) {
        refuse(fmt::format("a complete row {}", r), memory_.complaint);
      }
      for (const float value : row) {
        if (value != kMatchabilityNodata && value != 1 && value != 2 && value != 3) {
          refuse("classes 1, 2, 3, or -1 for none", fmt::format("{} in row {}", value, r));
        }
        cells_.classes.push_back(value < 0 ? MatchClass::outside : static_cast<MatchClass>(static_cast<int>(value)));
      }
    }
  }

  std::string name_;
  TiffMemory memory_;
  TiffHandle tiff_;
  MatchabilityCells cells_;
};

}  // namespace

MatchabilityRaster::MatchabilityRaster(MatchabilityCells cells) : cells_(std::move(cells)) {
  const MatchabilityCells& c = cells_;
  const auto refuse = [](std::string expected, std::string found) {
    throw Error(
        {.what = "the grid of matchability is invalid", .expected = std::move(expected), .found = std::move(found)});
  };
  if (c.columns < 1 || c.rows < 1 ||
      c.classes.size() != static_cast<std::size_t>(c.columns) * static_cast<std::size_t>(c.rows)) {
    refuse(fmt::format("{} x {} cells", c.columns, c.rows), fmt::format("{}", c.classes.size()));
  }
  const auto on_earth = [](double m) { return std::abs(m) <= kWorld_m + 1; };  // NaN is not
  if (!(c.side_m >= kLeastCell_m) || !on_earth(c.north_west.x_m) || !on_earth(c.north_west.y_m) ||
      !on_earth(c.north_west.x_m + c.columns * c.side_m) || !on_earth(c.north_west.y_m - c.rows * c.side_m)) {
    refuse(fmt::format("cells of {} m or more within the Web Mercator square", kLeastCell_m),
           fmt::format("{} x {} of {} m from {}, {}", c.columns, c.rows, c.side_m, c.north_west.x_m, c.north_west.y_m));
  }
}

MatchClass MatchabilityRaster::at(LonLat position) const {
  const MercatorXY place = mercator_from_lonlat(position);
  const double column = std::floor((place.x_m - cells_.north_west.x_m) / cells_.side_m);
  const double row = std::floor((cells_.north_west.y_m - place.y_m) / cells_.side_m);
  if (!(column >= 0 && row >= 0 && column < cells_.columns && row < cells_.rows)) return MatchClass::outside;
  return cells_.classes[static_cast<std::size_t>(row) * static_cast<std::size_t>(cells_.columns) +
                        static_cast<std::size_t>(column)];
}

MatchabilityRaster parse_matchability_raster(ByteView file, std::string_view name) {
  return MatchabilityTiff(file, name).read();
}

}  // namespace nadir
