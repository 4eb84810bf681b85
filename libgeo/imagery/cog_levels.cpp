#include "imagery/cog_levels.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <numbers>

#include "base/printable.hpp"
#include "geodesy/web_mercator.hpp"

namespace nadir {
namespace {

constexpr std::uint64_t kMaxSide = std::uint64_t{1} << 31;
constexpr std::uint64_t kMaxBlockSide = 4096;
constexpr std::uint64_t kMaxBlocks = std::uint64_t{1} << 24;
constexpr std::int64_t kMaxTiles = std::int64_t{1} << 26;  // that large blocks are cut into: a list of 800 MB
constexpr double kPixelTolerance = 0.02;  // how far a pixel may lie from its place on the grid, in pixels

class Reader {
 public:
  explicit Reader(const TiffFile& file) : file_(file) {}

  CogLevels read() {
    const Place place = read_place();
    result_.nodata = read_nodata();
    CogLevel main{place.zoom, place.west, place.north, read_blocks(0), std::nullopt};
    check_origin(main, place);
    result_.levels.push_back(std::move(main));
    std::map<std::pair<std::int64_t, std::int64_t>, std::size_t> masks;
    for (std::size_t i = 1; i < file_.directories(); ++i) {
      const std::uint64_t kind = file_.number(i, tiff::kSubfileType, 0);
      if ((kind & tiff::kMaskImage) != 0) {
        masks[{side(i, tiff::kWidth), side(i, tiff::kHeight)}] = i;
      } else if ((kind & tiff::kReducedImage) != 0) {
        add_overview(i);
      }
    }
    for (CogLevel& level : result_.levels) {
      const auto mask = masks.find({level.picture.width, level.picture.height});
      if (mask != masks.end()) level.mask = read_mask(mask->second);
    }
    return std::move(result_);
  }

 private:
  struct Place {
    int zoom = 0;
    std::int64_t west = 0, north = 0;
    double step = 0;  // pixels of the grid that one pixel of the file takes; nearly 1
    double x = 0, y = 0;
  };

  [[noreturn]] void off_grid(std::string expected, std::string found) const {
    throw CogError("tiff.grid",
                   {.what = "this GeoTIFF is not on the grid of web maps",
                    .where = file_.name(),
                    .expected = std::move(expected),
                    .found = std::move(found),
                    .fix = "gdal_translate -of COG -co TILING_SCHEME=GoogleMapsCompatible IN.tif OUT.tif"});
  }

  [[noreturn]] void refuse_layout(std::string expected, std::string found) const {
    throw CogError("tiff.layout", {.what = "this form of GeoTIFF is not read as a tile set",
                                   .where = file_.name(),
                                   .expected = std::move(expected),
                                   .found = std::move(found),
                                   .fix = "make a COG of 8 bit with `gdal_translate -of COG`"});
  }

  std::int64_t side(std::size_t directory, std::uint16_t tag) const {
    const std::uint64_t value = file_.number(directory, tag, 0);
    if (value < 1 || value > kMaxSide) {
      file_.corrupt(fmt::format("sides of 1 to {} pixels", kMaxSide), std::to_string(value));
    }
    return static_cast<std::int64_t>(value);
  }

  // Keys with their values inside the directory; texts and numbers elsewhere say nothing new.
  std::uint64_t geo_key(std::uint64_t wanted) const {
    const auto keys = file_.numbers(0, tiff::kGeoKeys, 4096);
    for (std::size_t i = 4; i + 3 < keys.size(); i += 4) {
      if (keys[i] == wanted && keys[i + 1] == 0) return keys[i + 3];
    }
    return 0;
  }

  Place read_place() const {
    constexpr std::uint64_t kModel = 1024, kRaster = 1025, kGeographic = 2048, kProjected = 3072;
    if (!file_.has(0, tiff::kGeoKeys)) off_grid("EPSG:3857", "no coordinate system");
    if (geo_key(kModel) != 1 || geo_key(kProjected) != 3857) {
      const std::uint64_t code = geo_key(kModel) == 2 ? geo_key(kGeographic) : geo_key(kProjected);
      off_grid("EPSG:3857", code == 0 || code == 32767 ? "another coordinate system" : fmt::format("EPSG:{}", code));
    }
    const auto scale = file_.reals(0, tiff::kPixelScale), tie = file_.reals(0, tiff::kTiepoint, 6);
    if (scale.size() < 2 || tie.size() != 6) {
      off_grid("a picture that lies north up: ModelPixelScale and one ModelTiepoint", "another georeference");
    }
    const double world_m = 2 * std::numbers::pi * kMercatorRadius_m;
    const double exact_zoom = std::log2(world_m / kTileSize / scale[0]);
    const double width = static_cast<double>(side(0, tiff::kWidth)),
                 height = static_cast<double>(side(0, tiff::kHeight));
    if (!std::isfinite(exact_zoom) || exact_zoom < -0.01 || exact_zoom > kMaxZoom + 0.01) {
      off_grid(fmt::format("pixels of a zoom from 0 to {}", kMaxZoom), fmt::format("pixels of {} m", scale[0]));
    }
    Place place;
    place.zoom = static_cast<int>(std::lround(exact_zoom));
    const double pixel_m = world_m / kTileSize / std::exp2(place.zoom);
    const double drift = std::max(std::abs(scale[0] / pixel_m - 1) * width, std::abs(scale[1] / pixel_m - 1) * height);
    if (!(drift < kPixelTolerance)) {
      off_grid(fmt::format("pixels of {:.12g} m (zoom {}) or of another zoom", pixel_m, place.zoom),
               fmt::format("{:.12g} x {:.12g} m", scale[0], scale[1]));
    }
    const double shift = geo_key(kRaster) == 2 ? 0.5 : 0.0;  // the place is that of the corner pixel's centre
    place.x = (tie[3] + world_m / 2) / pixel_m - tie[0] - shift;
    place.y = (world_m / 2 - tie[4]) / pixel_m - tie[1] - shift;
    const double across = kTileSize * std::exp2(place.zoom);
    if (!(place.x > -0.5 && place.y > -0.5 && place.x + width < across + 0.5 && place.y + height < across + 0.5)) {
      off_grid("a picture inside the map of the world", "one that reaches beyond");
    }
    place.west = std::llround(place.x), place.north = std::llround(place.y);
    return place;
  }

  void check_origin(const CogLevel& main, const Place& place) const {
    const double dx = std::abs(place.x - static_cast<double>(main.west));
    const double dy = std::abs(place.y - static_cast<double>(main.north));
    if (dx < kPixelTolerance && dy < kPixelTolerance) return;
    off_grid(fmt::format("pixels that lie on those of zoom {}", place.zoom),
             fmt::format("a corner {:.3f} pixels to the east and {:.3f} to the south of one",
                         place.x - std::floor(place.x), place.y - std::floor(place.y)));
  }

  std::optional<std::uint8_t> read_nodata() const {
    const Bytes raw = file_.bytes(0, tiff::kNodata, 64);
    if (raw.empty()) return std::nullopt;
    const std::string text(as_text(raw).substr(0, as_text(raw).find('\0')));
    double value = -1;
    const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), value);
    const bool usable = problem == std::errc() && value >= 0 && value <= 255 && value == std::floor(value);
    return usable ? std::optional(static_cast<std::uint8_t>(value)) : std::nullopt;  // no 8 bit value has it
  }

  CogBlocks read_blocks(std::size_t directory) const {
    CogBlocks blocks = read_table(directory);
    CogBlockForm& form = blocks.form;
    const auto bits = file_.numbers(directory, tiff::kBitsPerSample);
    if (bits.empty() || std::any_of(bits.begin(), bits.end(), [](std::uint64_t value) { return value != 8; })) {
      refuse_layout("8 bit per colour", bits.empty() ? "1 bit" : fmt::format("{} bit", bits.front()));
    }
    const std::uint64_t samples = file_.number(directory, tiff::kSamplesPerPixel, 1);
    const std::uint64_t photometric = file_.number(directory, tiff::kPhotometric, tiff::kGrey);
    const bool grey = photometric == tiff::kGrey || photometric == tiff::kWhiteIsZero;
    const bool colour = photometric == tiff::kRgb || (photometric == tiff::kYCbCr && form.compression == tiff::kJpeg);
    if (!(grey && samples <= 2) && !(colour && (samples == 3 || samples == 4))) {
      refuse_layout("grey or RGB, with or without alpha", fmt::format("{} bands of kind {}", samples, photometric));
    }
    const bool jpeg = form.compression == tiff::kJpeg, webp = form.compression == tiff::kWebp;
    if ((jpeg && samples % 2 == 0) || (webp && samples < 3)) {
      refuse_layout("JPEG without alpha (transparency as a mask), WebP in colour", fmt::format("{} bands", samples));
    }
    form.samples = static_cast<int>(samples);
    form.photometric = static_cast<std::uint16_t>(photometric);
    form.jpeg_tables = file_.bytes(directory, tiff::kJpegTables, 1 << 16);
    return blocks;
  }

  std::optional<CogBlocks> read_mask(std::size_t directory) const {
    CogBlocks blocks = read_table(directory);
    const std::uint64_t bits = file_.number(directory, tiff::kBitsPerSample, 1);
    const bool lossless = blocks.form.compression != tiff::kJpeg && blocks.form.compression != tiff::kWebp;
    if ((bits != 1 && bits != 8) || !lossless || file_.number(directory, tiff::kSamplesPerPixel, 1) != 1) {
      refuse_layout("a mask of 1 or 8 bit", "another");
    }
    blocks.form.bits = static_cast<int>(bits);
    return blocks;
  }

  // What pictures and masks have in common.
  CogBlocks read_table(std::size_t directory) const {
    CogBlocks blocks;
    blocks.width = side(directory, tiff::kWidth), blocks.height = side(directory, tiff::kHeight);
    if (!file_.has(directory, tiff::kTileWidth) || !file_.has(directory, tiff::kTileOffsets)) {
      refuse_layout("a picture in tiles", "one in strips");
    }
    const std::uint64_t planar = file_.number(directory, tiff::kPlanarConfig, 1);
    if (planar != 1 && file_.number(directory, tiff::kSamplesPerPixel, 1) != 1) {
      refuse_layout("colours side by side (INTERLEAVE=PIXEL)", "one plane per colour");
    }
    const std::uint64_t width = file_.number(directory, tiff::kTileWidth, 0);
    const std::uint64_t height = file_.number(directory, tiff::kTileHeight, 0);
    if (width < 16 || height < 16 || width > kMaxBlockSide || height > kMaxBlockSide) {
      refuse_layout(fmt::format("blocks of 16 to {} pixels a side", kMaxBlockSide),
                    fmt::format("{} x {}", width, height));
    }
    blocks.form.width = static_cast<int>(width), blocks.form.height = static_cast<int>(height);
    blocks.across = (blocks.width + blocks.form.width - 1) / blocks.form.width;
    blocks.down = (blocks.height + blocks.form.height - 1) / blocks.form.height;
    const auto count = static_cast<std::uint64_t>(blocks.across) * static_cast<std::uint64_t>(blocks.down);
    if (count > kMaxBlocks) refuse_layout(fmt::format("at most {} blocks", kMaxBlocks), std::to_string(count));
    const std::int64_t tiles = (blocks.width / kTileSize + 1) * (blocks.height / kTileSize + 1);
    if (tiles > kMaxTiles) refuse_layout(fmt::format("at most {} tiles", kMaxTiles), std::to_string(tiles));
    blocks.places = file_.numbers(directory, tiff::kTileOffsets, count);
    blocks.sizes = file_.numbers(directory, tiff::kTileSizes, count);
    if (blocks.places.size() != count || blocks.sizes.size() != count) {
      file_.corrupt(fmt::format("place and size of {} blocks", count),
                    fmt::format("{} places and {} sizes", blocks.places.size(), blocks.sizes.size()));
    }
    const std::uint64_t compression = file_.number(directory, tiff::kCompression, tiff::kNone);
    constexpr std::uint64_t kRead[] = {tiff::kNone,     tiff::kLzw,        tiff::kJpeg, tiff::kDeflate,
                                       tiff::kPackBits, tiff::kOldDeflate, tiff::kZstd, tiff::kWebp};
    if (std::find(std::begin(kRead), std::end(kRead), compression) == std::end(kRead)) {
      refuse_layout("no compression, LZW, deflate, ZSTD, PackBits, JPEG or WebP",
                    fmt::format("compression {}", compression));
    }
    blocks.form.compression = static_cast<std::uint16_t>(compression);
    const std::uint64_t predictor = file_.number(directory, tiff::kPredictor, 1);
    if (predictor != 1 && predictor != 2) refuse_layout("predictor 1 or 2", std::to_string(predictor));
    blocks.form.predictor = static_cast<std::uint16_t>(predictor);
    return blocks;
  }

  void add_overview(std::size_t directory) {
    const CogLevel& main = result_.levels.front();
    const std::int64_t width = side(directory, tiff::kWidth), height = side(directory, tiff::kHeight);
    const int steps =
        static_cast<int>(std::lround(std::log2(static_cast<double>(main.picture.width) / static_cast<double>(width))));
    const std::int64_t factor = std::int64_t{1} << std::clamp(steps, 0, 40);
    const auto rounded = [factor](std::int64_t pixels) { return (pixels + factor - 1) / factor; };
    const bool on_grid = steps >= 1 && steps <= main.zoom && main.west % factor == 0 && main.north % factor == 0 &&
                         width == rounded(main.picture.width) && height == rounded(main.picture.height);
    const bool again = std::any_of(result_.levels.begin(), result_.levels.end(),
                                   [&](const CogLevel& level) { return level.zoom == main.zoom - steps; });
    if (!on_grid || again) {
      result_.left_out.push_back(fmt::format("{} x {} pixels", width, height));
      return;
    }
    CogLevel level{main.zoom - steps, main.west / factor, main.north / factor, read_blocks(directory), std::nullopt};
    result_.levels.push_back(std::move(level));
  }

  const TiffFile& file_;
  CogLevels result_;
};

}  // namespace

bool CogLevel::native() const {
  const CogBlockForm& form = picture.form;
  const bool a_picture = form.compression == tiff::kJpeg || form.compression == tiff::kWebp;
  return a_picture && form.width == kTileSize && form.height == kTileSize && west % kTileSize == 0 &&
         north % kTileSize == 0;
}

CogLevels read_cog_levels(const TiffFile& file) {
  CogLevels result = Reader(file).read();
  std::sort(result.levels.begin(), result.levels.end(),
            [](const CogLevel& a, const CogLevel& b) { return a.zoom > b.zoom; });
  return result;
}

}  // namespace nadir
