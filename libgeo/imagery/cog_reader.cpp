#include "imagery/cog_reader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <opencv2/imgproc.hpp>

namespace nadir {
namespace {

constexpr std::uint64_t kMaxBlockBytes = std::uint64_t{64} << 20;  // as an MBTiles file's tile

}  // namespace

struct CogReader::Window {
  std::int64_t left = 0, top = 0;  // of the tile, in the level's pixels; may be negative
};

CogReader::CogReader(const std::filesystem::path& path)
    : CogReader(std::make_unique<FileBytes>(path), path.filename().string()) {}

CogReader::CogReader(std::unique_ptr<RandomBytes> bytes, std::string name)
    : bytes_(std::move(bytes)), name_(std::move(name)), levels_(read_cog_levels(TiffFile(*bytes_, name_))) {}

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
  // The size is held against the file before anything is allocated for it.
  Bytes bytes;
  const bool inside = size <= kMaxBlockBytes && size <= bytes_->size();
  if (inside) bytes.resize(size);
  if (inside && bytes_->read(blocks.places[index], bytes)) return bytes;
  throw CogError("tiff.corrupt", {.what = "a block lies outside of the file",
                                  .where = fmt::format("{}, block {}, {}", name_, column, row),
                                  .expected = fmt::format("a place inside {} bytes", bytes_->size()),
                                  .found = fmt::format("{} bytes at {}", size, blocks.places[index]),
                                  .fix = "make the file again; a copy of a damaged file stays damaged"});
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
    const CogBlockForm& form = at->picture.form;
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
        if (there) keys.push_back(key);
      }
    }
  }
  return keys;
}

}  // namespace nadir
