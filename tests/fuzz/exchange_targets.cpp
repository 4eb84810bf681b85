// What a stranger may upload: announcements and packs of tiles.
#include "base/sha256.hpp"
#include "upload/batch.hpp"
#include "upload/pack.hpp"
#include "fuzz/scratch.hpp"
#include "fuzz/targets.hpp"

namespace nadir::fuzz {

void batch(std::string_view bytes) {
  refusing([&] {
    const SignedBatch read = parse_batch(bytes, "fuzz");
    require(is_uuid(read.batch.id), "an id that is none");
    const SignedBatch again = parse_batch(read.json(), "fuzz");
    require(again.json() == read.json(), "a batch changes when it is written");
    for (const BatchTile& tile : read.batch.tiles) {
      require(candidate_json(tile.sidecar) == tile.sidecar_bytes, "a sidecar changes when it is written");
    }
  });
}

void pack(std::string_view bytes) {
  refusing([&] {
    Bytes tiles;
    PackReader reader(
        bytes.size(), [](const PackEntry& entry) { return entry.size != 77; },
        [&](const PackEntry& entry, ByteView tile) {
          require(sha256(tile) == entry.sha256, "a tile of another digest");
          tiles.insert(tiles.end(), tile.begin(), tile.end());
        });
    // Pieces of growing sizes: every boundary is crossed somewhere.
    for (std::size_t at = 0, piece = 1; at < bytes.size(); at += piece, ++piece) {
      reader.feed(as_bytes(bytes.substr(at, piece)));
    }
    reader.finish();
    Bytes whole = pack_head(reader.entries());
    whole.insert(whole.end(), tiles.begin(), tiles.end());
    require(as_text(whole) == bytes, "a pack changes when it is written");
  });
}

}  // namespace nadir::fuzz
