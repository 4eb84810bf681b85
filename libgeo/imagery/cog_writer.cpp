#include "imagery/cog_writer.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "base/error.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/tiff.hpp"

namespace nadir {
namespace {

// Structural metadata of GDAL's COG driver: what a reader may rely on. The size is that of the text after it.
constexpr std::string_view kStructure =
    "GDAL_STRUCTURAL_METADATA_SIZE=000140 bytes\n"
    "LAYOUT=IFDS_BEFORE_DATA\n"
    "BLOCK_ORDER=ROW_MAJOR\n"
    "BLOCK_LEADER=SIZE_AS_UINT4\n"
    "BLOCK_TRAILER=LAST_4_BYTES_REPEATED\n"
    "KNOWN_INCOMPATIBLE_EDITION=NO\n ";
constexpr std::size_t kBlock = 1 << 20;

// The image of one zoom: its size in tiles and the offset of each tile in the file, row by row.
struct Level {
  int zoom = 0;
  std::uint64_t columns = 0, rows = 0;
  std::vector<std::uint64_t> offsets;
  std::vector<std::uint32_t> sizes;
};

void check(const CogShape& shape) {
  const int steps = shape.zooms.max - shape.zooms.min;
  const std::uint64_t finest = (std::uint64_t{shape.columns} * shape.rows) << (2 * std::clamp(steps, 0, 24));
  if (steps >= 0 && shape.columns > 0 && shape.rows > 0 && finest <= kMaxCogTiles) return;
  throw UsageError(
      {.what = "a COG would have too many tile addresses",
       .where = fmt::format("zoom {} to {}", shape.zooms.min, shape.zooms.max),
       .expected = fmt::format("at most {}: the area is widened to whole tiles of the coarsest zoom", kMaxCogTiles),
       .found = std::to_string(finest),
       .fix = "raise zoom.min in the mission, or use --format mbtiles"});
}

TiffTags tags_of(const Level& level, const CogShape& shape, ImageFormat format, bool big) {
  TiffTags tags(big);
  const bool finest = level.zoom == shape.zooms.max, jpeg = format == ImageFormat::jpeg;
  tags.long_(tiff::kSubfileType, finest ? 0 : tiff::kReducedImage);
  tags.long_(tiff::kWidth, static_cast<std::uint32_t>(level.columns * kTileSize));
  tags.long_(tiff::kHeight, static_cast<std::uint32_t>(level.rows * kTileSize));
  tags.shorts(tiff::kBitsPerSample, {8, 8, 8});
  tags.shorts(tiff::kCompression, {jpeg ? tiff::kJpeg : tiff::kWebp});
  tags.shorts(tiff::kPhotometric, {jpeg ? tiff::kYCbCr : tiff::kRgb});
  tags.shorts(tiff::kSamplesPerPixel, {3});
  tags.shorts(tiff::kPlanarConfig, {1});
  tags.shorts(tiff::kTileWidth, {kTileSize});
  tags.shorts(tiff::kTileHeight, {kTileSize});
  tags.places(tiff::kTileOffsets, level.offsets);
  tags.longs(tiff::kTileSizes, level.sizes);
  tags.shorts(tiff::kSampleFormat, {1, 1, 1});
  if (jpeg) tags.shorts(tiff::kChromaSubsampling, {2, 2});
  if (!finest) return tags;
  const double world_m = 2 * kMercatorHalfWorld_m;
  const double tile_m = world_m / static_cast<double>(std::uint32_t{1} << shape.zooms.min);
  const double pixel_m = world_m / kTileSize / static_cast<double>(std::uint32_t{1} << shape.zooms.max);
  tags.doubles(tiff::kPixelScale, {pixel_m, pixel_m, 0});
  tags.doubles(tiff::kTiepoint,
               {0, 0, 0, shape.first_x * tile_m - world_m / 2, world_m / 2 - shape.first_y * tile_m, 0});
  // Key, place of the value (0: here), count, value. A projected image whose pixels are areas, in EPSG:3857, metres.
  tags.shorts(tiff::kGeoKeys,
              {1, 1, 0, 5, 1024, 0, 1, 1, 1025, 0, 1, 1, 1026, 34737, 25, 0, 3072, 0, 1, 3857, 3076, 0, 1, 9001});
  tags.text(tiff::kGeoTexts, "WGS 84 / Pseudo-Mercator|");
  return tags;
}

// Coarse zooms first: the order of the tiles in the file.
std::vector<Level> levels_of(const CogShape& shape) {
  std::vector<Level> levels;
  for (int zoom = shape.zooms.min; zoom <= shape.zooms.max; ++zoom) {
    const int steps = zoom - shape.zooms.min;
    Level level{zoom, std::uint64_t{shape.columns} << steps, std::uint64_t{shape.rows} << steps, {}, {}};
    level.offsets.resize(level.columns * level.rows);
    level.sizes.resize(level.columns * level.rows);
    levels.push_back(std::move(level));
  }
  return levels;
}

// Finest first, as readers expect them. Empty entries take as many bytes as others.
Bytes directories_of(const std::vector<Level>& levels, const CogShape& shape, ImageFormat format, bool big) {
  const std::uint64_t head = (big ? 16 : 8) + kStructure.size();
  Bytes bytes = tiff_header(big, head + head % 2);
  bytes.insert(bytes.end(), kStructure.begin(), kStructure.end());
  bytes.resize(head + head % 2, 0);
  for (std::size_t i = levels.size(); i-- > 0;) {
    const TiffTags tags = tags_of(levels[i], shape, format, big);
    const Bytes written = tags.write(bytes.size(), i == 0 ? 0 : bytes.size() + tags.size());
    bytes.insert(bytes.end(), written.begin(), written.end());
  }
  return bytes;
}

void append_u32(Bytes& out, std::uint32_t value) {
  for (int shift = 0; shift < 32; shift += 8) out.push_back(static_cast<std::uint8_t>(value >> shift));
}

}  // namespace

CogWriter::CogWriter(std::filesystem::path path, const CogShape& shape, ImageFormat format, std::uint64_t classic_limit)
    : path_(std::move(path)),
      spool_path_(path_.string() + ".tiles"),
      shape_((check(shape), shape)),
      format_(format),
      classic_limit_(classic_limit),
      spool_(spool_path_) {
  if (format != ImageFormat::jpeg && format != ImageFormat::webp) {
    throw UsageError({.what = "a COG cannot hold tiles of this format",
                      .expected = "jpeg or webp (lossless WebP instead of PNG)",
                      .found = std::string(name_of(format))});
  }
  if (std::filesystem::exists(path_)) {
    throw Error({.what = "the file exists", .where = path_.string(), .fix = "choose another name"});
  }
  spool_.cut(0);
}

CogWriter::~CogWriter() {
  std::error_code ignored;
  std::filesystem::remove(spool_path_, ignored);
}

void CogWriter::add(const TileKey& key, ByteView encoded) {
  const int steps = key.z - shape_.zooms.min;
  const bool inside = steps >= 0 && key.z <= shape_.zooms.max && (key.x >> steps) >= shape_.first_x &&
                      (key.y >> steps) >= shape_.first_y && (key.x >> steps) - shape_.first_x < shape_.columns &&
                      (key.y >> steps) - shape_.first_y < shape_.rows;
  if (!inside || encoded.empty() || encoded.size() > (64U << 20)) {
    throw Error({.what = "this tile lies outside the COG", .where = "tile " + to_text(key)});
  }
  tiles_.push_back({key, static_cast<std::uint32_t>(encoded.size()), spool_.position()});
  spool_.append(encoded);
}

void CogWriter::finish() {
  std::sort(tiles_.begin(), tiles_.end(), [](const SpooledTile& a, const SpooledTile& b) {
    return std::tie(a.key.z, a.key.y, a.key.x) < std::tie(b.key.z, b.key.y, b.key.x);
  });
  const auto twice = std::adjacent_find(tiles_.begin(), tiles_.end(),
                                        [](const SpooledTile& a, const SpooledTile& b) { return a.key == b.key; });
  if (twice != tiles_.end()) throw Error({.what = "a tile was added twice", .where = "tile " + to_text(twice->key)});

  std::vector<Level> levels = levels_of(shape_);
  const auto data_size = spool_.position() + 8 * tiles_.size();
  const bool big = directories_of(levels, shape_, format_, false).size() + data_size > classic_limit_;
  std::uint64_t place = directories_of(levels, shape_, format_, big).size();
  for (const SpooledTile& tile : tiles_) {
    const int steps = tile.key.z - shape_.zooms.min;
    Level& level = levels[static_cast<std::size_t>(steps)];
    const std::uint64_t x = tile.key.x - (std::uint64_t{shape_.first_x} << steps);
    const std::uint64_t y = tile.key.y - (std::uint64_t{shape_.first_y} << steps);
    level.offsets[y * level.columns + x] = place + 4;
    level.sizes[y * level.columns + x] = tile.size;
    place += std::uint64_t{tile.size} + 8;
  }

  AppendFile file(path_);
  const FileBytes spool{InputFile(spool_path_)};
  Bytes block = directories_of(levels, shape_, format_, big);
  for (const SpooledTile& tile : tiles_) {
    append_u32(block, tile.size);
    const std::size_t begin = block.size();
    block.resize(begin + tile.size);
    if (!spool.read(tile.at, std::span(block).subspan(begin))) {
      throw Error({.what = "the temporary file with the tiles is incomplete",
                   .where = spool_path_.string(),
                   .found = "it ends early: something else has changed it",
                   .fix = "build again, and leave the output's folder to this process meanwhile"});
    }
    for (std::size_t back = 4; back > 0; --back) {
      block.push_back(tile.size >= back ? block[begin + tile.size - back] : std::uint8_t{0});
    }
    if (block.size() < kBlock) continue;
    file.append(block);
    block.clear();
  }
  file.append(block);
}

}  // namespace nadir
