#include "imagery/cog_reader.hpp"

#include <fmt/format.h>
#include <tiffio.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"
#include "base/printable.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/tiff_memory.hpp"

namespace nadir {
namespace {

// JPEG and WebP are decoded by their own libraries. libtiff decodes the rest (no compression, LZW, deflate, ZSTD,
// predictors): it reads a small TIFF of one block in memory, which is written here, never the file from outside.
Bytes tiff_of_one_block(const CogBlockLayout& form, ByteView block) {
  TiffTags tags(false);
  const auto bits = static_cast<std::uint16_t>(form.bits);
  tags.long_(tiff::kWidth, static_cast<std::uint32_t>(form.width));
  tags.long_(tiff::kHeight, static_cast<std::uint32_t>(form.height));
  switch (form.samples) {
    case 1: tags.shorts(tiff::kBitsPerSample, {bits}); break;
    case 2: tags.shorts(tiff::kBitsPerSample, {bits, bits}); break;
    case 3: tags.shorts(tiff::kBitsPerSample, {bits, bits, bits}); break;
    default: tags.shorts(tiff::kBitsPerSample, {bits, bits, bits, bits}); break;
  }
  tags.shorts(tiff::kCompression, {form.compression});
  tags.shorts(tiff::kPhotometric, {form.samples >= 3 ? tiff::kRgb : tiff::kGrey});
  tags.shorts(tiff::kSamplesPerPixel, {static_cast<std::uint16_t>(form.samples)});
  tags.shorts(tiff::kPlanarConfig, {1});
  if (form.predictor != 1) tags.shorts(tiff::kPredictor, {form.predictor});
  tags.long_(tiff::kTileWidth, static_cast<std::uint32_t>(form.width));
  tags.long_(tiff::kTileHeight, static_cast<std::uint32_t>(form.height));
  if (form.samples % 2 == 0) tags.shorts(tiff::kExtraSamples, {2});
  tags.long_(tiff::kTileSizes, static_cast<std::uint32_t>(block.size()));
  tags.long_(tiff::kTileOffsets, 0);
  tags.long_(tiff::kTileOffsets, static_cast<std::uint32_t>(8 + tags.size()));
  Bytes file = tiff_header(false, 8);
  const Bytes directory = tags.write(8, 0);
  file.insert(file.end(), directory.begin(), directory.end());
  file.insert(file.end(), block.begin(), block.end());
  return file;
}

Bytes decode_by_libtiff(const CogBlockLayout& form, ByteView block, std::string_view name) {
  const Bytes file = tiff_of_one_block(form, block);
  TiffMemory memory{file};
  const TiffHandle tiff = open_tiff(memory, "block", 0);
  const std::size_t row =
      (static_cast<std::size_t>(form.width) * static_cast<std::size_t>(form.samples * form.bits) + 7) / 8;
  Bytes pixels(row * static_cast<std::size_t>(form.height));
  const auto size = static_cast<tmsize_t>(pixels.size());
  if (!tiff || TIFFTileSize(tiff.get()) != size || TIFFReadEncodedTile(tiff.get(), 0, pixels.data(), size) != size) {
    throw Error({.what = "cannot decode the block",
                 .where = std::string(name),
                 .expected = fmt::format("{} x {} pixels", form.width, form.height),
                 .found = memory.complaint.empty() ? "damaged data" : memory.complaint});
  }
  return pixels;
}

DecodedImage picture_of(const CogBlockLayout& form, Bytes& pixels) {
  if (form.bits == 1) {
    cv::Mat mask(form.height, form.width, CV_8UC1);
    const std::size_t row_bytes = (static_cast<std::size_t>(form.width) + 7) / 8;
    for (int row = 0; row < form.height; ++row) {
      const std::uint8_t* from = pixels.data() + static_cast<std::size_t>(row) * row_bytes;
      for (int column = 0; column < form.width; ++column) {
        mask.at<std::uint8_t>(row, column) = (from[column / 8] >> (7 - column % 8)) % 2 != 0 ? 255 : 0;
      }
    }
    return {mask, {}};
  }
  const cv::Mat raw(form.height, form.width, CV_8UC(form.samples), pixels.data());
  DecodedImage result;
  if (form.samples % 2 == 0) cv::extractChannel(raw, result.alpha, form.samples - 1);
  if (form.samples <= 2) {
    cv::extractChannel(raw, result.image, 0);
    if (form.photometric == tiff::kWhiteIsZero) cv::bitwise_not(result.image, result.image);
  } else {
    cv::cvtColor(raw, result.image, form.samples == 4 ? cv::COLOR_RGBA2BGR : cv::COLOR_RGB2BGR);
  }
  return result;
}

}  // namespace

Bytes whole_jpeg(const CogBlockLayout& form, ByteView block) {
  const bool jpeg = block.size() >= 4 && block[0] == 0xff && block[1] == 0xd8;
  if (!jpeg) return {block.begin(), block.end()};
  Bytes result{0xff, 0xd8};
  // Without this mark decoders take three colours for YCbCr.
  constexpr std::array<std::uint8_t, 16> kAdobeRgb{0xff, 0xee, 0, 14, 'A', 'd', 'o', 'b', 'e', 0, 100, 0, 0, 0, 0, 0};
  if (form.samples == 3 && form.photometric == tiff::kRgb)
    result.insert(result.end(), kAdobeRgb.begin(), kAdobeRgb.end());
  // The tables are a JPEG of their own, without picture: begin, tables, end.
  const Bytes& tables = form.jpeg_tables;
  if (tables.size() > 4 && tables[0] == 0xff && tables[1] == 0xd8) {
    const bool ended = tables[tables.size() - 2] == 0xff && tables.back() == 0xd9;
    result.insert(result.end(), tables.begin() + 2, tables.end() - (ended ? 2 : 0));
  }
  if (result.size() == 2) return {block.begin(), block.end()};
  result.insert(result.end(), block.begin() + 2, block.end());
  return result;
}

DecodedImage decode_cog_block(const CogBlockLayout& form, ByteView block, std::string_view name) {
  if (form.compression != tiff::kJpeg && form.compression != tiff::kWebp) {
    Bytes pixels = decode_by_libtiff(form, block, name);
    return picture_of(form, pixels);
  }
  const bool jpeg = form.compression == tiff::kJpeg;
  const Bytes whole = jpeg ? whole_jpeg(form, block) : Bytes(block.begin(), block.end());
  const ImageInfo info = read_image_info(whole, name);  // before pixels are allocated
  if (info.width != form.width || info.height != form.height) {
    throw Error({.what = "a block has the wrong size",
                 .where = std::string(name),
                 .expected = fmt::format("{} x {} pixels", form.width, form.height),
                 .found = fmt::format("{} x {}", info.width, info.height)});
  }
  return decode_image(whole, jpeg && form.samples == 1 ? Colour::grey : Colour::bgr, name);
}

namespace {

constexpr std::uint64_t kMaxSide = std::uint64_t{1} << 31;
constexpr std::uint64_t kMaxBlockSide = 4096;
constexpr std::uint64_t kMaxBlockBytes = std::uint64_t{64} << 20;  // as a tile in an MBTiles file
constexpr std::uint64_t kMaxBlocks = std::uint64_t{1} << 24;
constexpr std::int64_t kMaxPlaces = std::int64_t{1} << 26;  // of tiles in one image: keys() visits each
constexpr double kPixelTolerance = 0.02;  // how far a pixel may lie from its place on the grid, in pixels

class LevelReader {
 public:
  LevelReader(const TiffFile& file, const CogLimits& limits) : file_(file), limits_(limits) {}

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
    throw TiffError("tiff.grid",
                    {.what = "this GeoTIFF is not on the grid of web maps",
                     .where = file_.name(),
                     .expected = std::move(expected),
                     .found = std::move(found),
                     .fix = "gdal_translate -of COG -co TILING_SCHEME=GoogleMapsCompatible IN.tif OUT.tif"});
  }

  [[noreturn]] void refuse_layout(std::string expected, std::string found) const {
    throw TiffError("tiff.layout", {.what = "this layout of GeoTIFF is not supported as a tile set",
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
      off_grid("a north-up image: ModelPixelScale and one ModelTiepoint", "another georeference");
    }
    const double world_m = 2 * kMercatorHalfWorld_m;
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
      off_grid("an image inside the map of the world", "one that extends beyond it");
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

  CogBlocks read_blocks(std::size_t directory) {
    CogBlocks blocks = read_table(directory);
    CogBlockLayout& form = blocks.form;
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

  std::optional<CogBlocks> read_mask(std::size_t directory) {
    CogBlocks blocks = read_table(directory);
    const std::uint64_t bits = file_.number(directory, tiff::kBitsPerSample, 1);
    const bool lossless = blocks.form.compression != tiff::kJpeg && blocks.form.compression != tiff::kWebp;
    if ((bits != 1 && bits != 8) || !lossless || file_.number(directory, tiff::kSamplesPerPixel, 1) != 1) {
      refuse_layout("a mask of 1 or 8 bit", "another");
    }
    blocks.form.bits = static_cast<int>(bits);
    return blocks;
  }

  // What pictures and masks have in common. Everything is bounded before anything is allocated for it.
  CogBlocks read_table(std::size_t directory) {
    CogBlocks blocks;
    blocks.width = side(directory, tiff::kWidth), blocks.height = side(directory, tiff::kHeight);
    if (!file_.has(directory, tiff::kTileWidth) || !file_.has(directory, tiff::kTileOffsets)) {
      refuse_layout("a tiled image", "one in strips");
    }
    const std::uint64_t planar = file_.number(directory, tiff::kPlanarConfig, 1);
    if (planar != 1 && file_.number(directory, tiff::kSamplesPerPixel, 1) != 1) {
      refuse_layout("interleaved bands (INTERLEAVE=PIXEL)", "one plane per colour");
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
    const std::int64_t places = (blocks.width / kTileSize + 1) * (blocks.height / kTileSize + 1);
    if (places > kMaxPlaces) refuse_layout(fmt::format("at most {} tiles", kMaxPlaces), std::to_string(places));
    blocks_ += count;
    if (blocks_ > limits_.blocks) {
      refuse_layout(fmt::format("at most {} blocks in all images together", limits_.blocks), "more");
    }
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
  CogLimits limits_;
  std::uint64_t blocks_ = 0;  // of all directories so far
  CogLevels result_;
};

}  // namespace

bool CogLevel::native() const {
  const CogBlockLayout& form = picture.form;
  const bool a_picture = form.compression == tiff::kJpeg || form.compression == tiff::kWebp;
  return a_picture && form.width == kTileSize && form.height == kTileSize && west % kTileSize == 0 &&
         north % kTileSize == 0;
}

CogLimits CogLimits::for_tiles(std::uint64_t tiles) {
  constexpr std::uint64_t kLeastBlocks = std::uint64_t{1} << 22;  // 64 MB of places and sizes
  constexpr std::uint64_t kBlocksPerTile = 64;                    // of a corridor across its rectangle
  CogLimits limits;
  limits.blocks = std::min(limits.blocks, kLeastBlocks + kBlocksPerTile * std::min(tiles, limits.blocks));
  limits.tiles = std::min(limits.tiles, tiles);
  return limits;
}

CogLevels read_cog_levels(const TiffFile& file, const CogLimits& limits) {
  CogLevels result = LevelReader(file, limits).read();
  std::sort(result.levels.begin(), result.levels.end(),
            [](const CogLevel& a, const CogLevel& b) { return a.zoom > b.zoom; });
  return result;
}

struct CogReader::Window {
  std::int64_t left = 0, top = 0;  // of the tile, in the level's pixels; may be negative
};

CogReader::CogReader(const std::filesystem::path& path) : CogReader(InputFile(path)) {}

CogReader::CogReader(InputFile file, const CogLimits& limits)
    : name_(file.path().filename().string()), limits_(limits) {
  bytes_ = std::make_unique<FileBytes>(std::move(file));
  levels_ = read_cog_levels(TiffFile(*bytes_, name_), limits_);
}

CogReader::CogReader(std::unique_ptr<RandomBytes> bytes, std::string name, const CogLimits& limits)
    : bytes_(std::move(bytes)),
      name_(std::move(name)),
      limits_(limits),
      levels_(read_cog_levels(TiffFile(*bytes_, name_), limits_)) {}

ZoomRange CogReader::zooms() const { return {levels_.levels.back().zoom, levels_.levels.front().zoom}; }

const CogLevel* CogReader::level(int zoom) const {
  const auto found = std::find_if(levels_.levels.begin(), levels_.levels.end(),
                                  [zoom](const CogLevel& level) { return level.zoom == zoom; });
  return found == levels_.levels.end() ? nullptr : &*found;
}

std::optional<Bytes> CogReader::block(const CogBlocks& blocks, std::int64_t column, std::int64_t row) const {
  const auto index = static_cast<std::size_t>(row * blocks.across + column);
  const std::uint64_t size = blocks.sizes[index];
  if (size == 0) return std::nullopt;
  // The size is checked against the file before anything is allocated for it.
  Bytes bytes;
  const bool inside = size <= kMaxBlockBytes && size <= bytes_->size();
  if (inside) bytes.resize(size);
  if (inside && bytes_->read(blocks.places[index], bytes)) return bytes;
  throw TiffError("tiff.corrupt", {.what = "a block lies outside the file",
                                   .where = fmt::format("{}, block {}, {}", name_, column, row),
                                   .expected = fmt::format("an offset within {} bytes", bytes_->size()),
                                   .found = fmt::format("{} bytes at {}", size, blocks.places[index]),
                                   .fix = "create the file again; copies of a damaged file are damaged as well"});
}

// Blocks that are tiles: the tile's own, when the picture has one there.
std::optional<std::size_t> CogReader::native_block(const CogLevel& level, const TileKey& key) const {
  const std::int64_t column = std::int64_t{key.x} - level.west / kTileSize;
  const std::int64_t row = std::int64_t{key.y} - level.north / kTileSize;
  if (column < 0 || row < 0 || column >= level.picture.across || row >= level.picture.down) return std::nullopt;
  return static_cast<std::size_t>(row * level.picture.across + column);
}

std::uint64_t CogReader::stored_size(const TileKey& key) const {
  const CogLevel* at = level(key.z);
  if (at == nullptr || !at->native()) return 0;
  const auto index = native_block(*at, key);
  return index ? at->picture.sizes[*index] : 0;
}

std::optional<Bytes> CogReader::read(const TileKey& key) const {
  const CogLevel* at = level(key.z);
  if (at == nullptr || !key.valid()) return std::nullopt;
  if (at->native()) {
    const auto index = native_block(*at, key);
    if (!index) return std::nullopt;
    const auto across = static_cast<std::size_t>(at->picture.across);
    auto bytes =
        block(at->picture, static_cast<std::int64_t>(*index % across), static_cast<std::int64_t>(*index / across));
    if (!bytes || at->picture.form.compression != tiff::kJpeg) return bytes;
    const CogBlockLayout& form = at->picture.form;
    if (form.jpeg_tables.empty() && form.photometric != tiff::kRgb) return bytes;
    return whole_jpeg(form, *bytes);
  }
  if (!any_block(*at, key)) return std::nullopt;
  const DecodedImage tile = assemble(*at, key);
  if (cv::countNonZero(tile.alpha) == 0) return std::nullopt;
  if (cv::countNonZero(tile.alpha) == kTileSize * kTileSize) return encode_image(tile.image, ImageFormat::png);
  cv::Mat colour = tile.image, pixels;
  if (colour.channels() == 1) cv::cvtColor(colour, colour, cv::COLOR_GRAY2BGR);
  const cv::Mat parts[] = {colour, tile.alpha};
  const int order[] = {0, 0, 1, 1, 2, 2, 3, 3};
  pixels.create(kTileSize, kTileSize, CV_8UC4);
  cv::mixChannels(parts, 2, &pixels, 1, order, 4);
  return encode_image(pixels, ImageFormat::png);
}

// Whether the file knows pixels of this tile that show nothing, apart from transparent WebP.
bool CogReader::is_masked(const CogLevel& level, const TileKey& key) const {
  const std::int64_t right = (std::int64_t{key.x} + 1) * kTileSize - level.west;
  const std::int64_t bottom = (std::int64_t{key.y} + 1) * kTileSize - level.north;
  return level.mask || levels_.nodata || right > level.picture.width || bottom > level.picture.height;
}

std::optional<Bytes> CogReader::read_mask(const TileKey& key) const {
  const CogLevel* at = level(key.z);
  if (at == nullptr || !key.valid() || !at->native() || !is_masked(*at, key) || stored_size(key) == 0) {
    return std::nullopt;
  }
  const DecodedImage tile = assemble(*at, key);
  if (cv::countNonZero(tile.alpha) == kTileSize * kTileSize) return std::nullopt;
  return encode_image(tile.alpha, ImageFormat::png);
}

bool CogReader::any_block(const CogLevel& level, const TileKey& key) const {
  const CogBlocks& blocks = level.picture;
  const std::int64_t left = std::int64_t{key.x} * kTileSize - level.west;
  const std::int64_t top = std::int64_t{key.y} * kTileSize - level.north;
  const std::int64_t right = std::min(left + kTileSize, blocks.width);
  const std::int64_t bottom = std::min(top + kTileSize, blocks.height);
  for (std::int64_t y = std::max<std::int64_t>(0, top) / blocks.form.height; y * blocks.form.height < bottom; ++y) {
    for (std::int64_t x = std::max<std::int64_t>(0, left) / blocks.form.width; x * blocks.form.width < right; ++x) {
      if (blocks.sizes[static_cast<std::size_t>(y * blocks.across + x)] != 0) return true;
    }
  }
  return false;
}

void CogReader::paste(const CogBlocks& blocks, const Window& window, DecodedImage& into, bool mask) const {
  const cv::Rect tile(0, 0, kTileSize, kTileSize);
  const std::int64_t right = std::min(window.left + kTileSize, blocks.width);
  const std::int64_t bottom = std::min(window.top + kTileSize, blocks.height);
  for (std::int64_t y = std::max<std::int64_t>(0, window.top) / blocks.form.height; y * blocks.form.height < bottom;
       ++y) {
    for (std::int64_t x = std::max<std::int64_t>(0, window.left) / blocks.form.width; x * blocks.form.width < right;
         ++x) {
      const auto bytes = block(blocks, x, y);
      if (!bytes) continue;
      const DecodedImage picture = decode_cog_block(blocks.form, *bytes, fmt::format("{}, block {}, {}", name_, x, y));
      // The block inside the picture, seen from the tile.
      const std::int64_t left = x * blocks.form.width, top = y * blocks.form.height;
      const cv::Rect whole(static_cast<int>(left - window.left), static_cast<int>(top - window.top),
                           static_cast<int>(std::min<std::int64_t>(blocks.form.width, blocks.width - left)),
                           static_cast<int>(std::min<std::int64_t>(blocks.form.height, blocks.height - top)));
      const cv::Rect place = whole & tile;
      if (place.empty()) continue;
      const cv::Rect from = place - whole.tl();
      if (mask) {
        picture.image(from).copyTo(into.alpha(place));
        continue;
      }
      if (into.image.empty()) into.image = cv::Mat::zeros(kTileSize, kTileSize, picture.image.type());
      picture.image(from).copyTo(into.image(place));
      cv::Mat alpha(place.size(), CV_8UC1, cv::Scalar(255));
      if (!picture.alpha.empty()) picture.alpha(from).copyTo(alpha);
      if (levels_.nodata) {
        cv::Mat unknown;
        cv::inRange(picture.image(from), cv::Scalar::all(*levels_.nodata), cv::Scalar::all(*levels_.nodata), unknown);
        alpha.setTo(0, unknown);
      }
      alpha.copyTo(into.alpha(place));
    }
  }
}

DecodedImage CogReader::assemble(const CogLevel& level, const TileKey& key) const {
  const Window window{std::int64_t{key.x} * kTileSize - level.west, std::int64_t{key.y} * kTileSize - level.north};
  DecodedImage tile{{}, cv::Mat::zeros(kTileSize, kTileSize, CV_8UC1)};
  paste(level.picture, window, tile, false);
  if (tile.image.empty()) tile.image = cv::Mat::zeros(kTileSize, kTileSize, CV_8UC3);
  if (level.mask) {
    DecodedImage valid{{}, cv::Mat::zeros(kTileSize, kTileSize, CV_8UC1)};
    paste(*level.mask, window, valid, true);
    cv::min(tile.alpha, valid.alpha, tile.alpha);
  }
  return tile;
}

std::vector<TileKey> CogReader::keys() const {
  std::vector<TileKey> keys;
  for (auto at = levels_.levels.rbegin(); at != levels_.levels.rend(); ++at) {
    const std::int64_t last_x = (at->west + at->picture.width - 1) / kTileSize;
    const std::int64_t last_y = (at->north + at->picture.height - 1) / kTileSize;
    for (std::int64_t x = at->west / kTileSize; x <= last_x; ++x) {
      for (std::int64_t y = at->north / kTileSize; y <= last_y; ++y) {
        const TileKey key{static_cast<std::uint8_t>(at->zoom), static_cast<std::uint32_t>(x),
                          static_cast<std::uint32_t>(y)};
        const bool there = key.valid() && (at->native() ? stored_size(key) != 0 : any_block(*at, key));
        if (!there) continue;
        if (keys.size() == limits_.tiles) {
          throw TiffError("tiff.layout", {.what = "this COG holds too many tiles",
                                          .where = name_,
                                          .expected = fmt::format("at most {} tiles", limits_.tiles),
                                          .found = "more",
                                          .fix = "get the file again from its origin"});
        }
        keys.push_back(key);
      }
    }
  }
  return keys;
}

}  // namespace nadir
