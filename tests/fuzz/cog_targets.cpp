// COGs from anybody: a whole file's bytes, through the reader that aircraft use (no GDAL).
#include <algorithm>

#include "fuzz/scratch.hpp"
#include "fuzz/targets.hpp"
#include "imagery/cog_reader.hpp"

namespace nadir::fuzz {
namespace {

constexpr std::int64_t kQuick = 1'000'000;  // pixels of a block: larger ones are allowed, but slow

void require_tile(const CogReader& reader, const TileKey& key, bool native) {
  refusing([&] {
    const std::optional<Bytes> tile = reader.read(key);
    require(!native || tile.has_value(), "a block that is no tile");
    if (!tile || native) return;  // the bytes of a block are another target's: picture
    const DecodedImage image = decode_image(*tile, Colour::bgr, "fuzz");
    require(image.image.cols == kTileSize && image.image.rows == kTileSize, "a cut tile of another size");
  });
  refusing([&] {
    const std::optional<Bytes> mask = reader.read_mask(key);
    if (!mask) return;
    const DecodedImage image = decode_image(*mask, Colour::grey, "fuzz");
    require(image.image.cols == kTileSize && image.image.rows == kTileSize, "a mask of another size");
  });
}

}  // namespace

void cog(std::string_view bytes) {
  refusing([&] {
    const CogReader reader(std::make_unique<MemoryBytes>(as_bytes(bytes)), "fuzz");
    const std::vector<CogLevel>& levels = reader.levels();
    require(reader.zooms().min >= 0 && reader.zooms().max <= kMaxZoom, "a zoom outside of the grid");
    require(std::is_sorted(levels.begin(), levels.end(),
                           [](const CogLevel& a, const CogLevel& b) { return a.zoom > b.zoom; }),
            "levels out of order");
    std::int64_t tiles = 0;
    for (const CogLevel& level : levels) {
      const CogBlocks& blocks = level.picture;
      tiles += (blocks.width / kTileSize + 2) * (blocks.height / kTileSize + 2);
      for (const CogBlocks* part : {&blocks, level.mask ? &*level.mask : &blocks}) {
        if (std::int64_t{part->form.width} * part->form.height > kQuick) return;
      }
    }
    if (tiles > 10'000) return;
    const std::vector<TileKey> keys = reader.keys();
    require(std::is_sorted(keys.begin(), keys.end()), "tiles out of order");
    require(std::adjacent_find(keys.begin(), keys.end()) == keys.end(), "one tile twice");
    const std::size_t step = 1 + keys.size() / 4;
    for (std::size_t i = 0; i < keys.size(); i += step) {
      require(keys[i].valid(), "an address outside of the grid");
      const CogLevel* level = reader.level(keys[i].z);
      require(level != nullptr, "a tile of a zoom that is not there");
      require_tile(reader, keys[i], level->native());
    }
  });
}

}  // namespace nadir::fuzz
