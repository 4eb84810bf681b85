#include "package_build/update_metatile.hpp"

#include <algorithm>
#include <set>

namespace nadir {
namespace {

template <typename Visit>
void for_each_key(const TileKey& metatile, int zoom, Visit visit) {  // in the order of cut_metatile()
  const int steps = zoom - metatile.z, across = 1 << steps;
  for (int column = 0; column < across; ++column) {
    for (int row = 0; row < across; ++row) {
      visit(TileKey{static_cast<std::uint8_t>(zoom), (metatile.x << steps) + static_cast<std::uint32_t>(column),
                    (metatile.y << steps) + static_cast<std::uint32_t>(row)});
    }
  }
}

// Nothing is decoded but the top. An overview stays when a tile of the finest zoom below it does.
UpdatedMetatile copy_metatile(const TileKey& key, const UpdateWork& work) {
  UpdatedMetatile result;
  std::set<TileKey> wanted;
  for (int zoom = work.range.zoom; zoom >= key.z; --zoom) {
    for_each_key(key, zoom, [&](const TileKey& tile_key) {
      if (zoom == work.range.zoom ? !work.range.contains(tile_key) : !wanted.contains(tile_key)) return;
      if (work.old.sidecar(tile_key) == nullptr) return;
      wanted.insert(tile_key.parent());
      std::optional<EncodedTile> tile = work.old.copy(tile_key);
      if (!tile) return;  // damaged: its finding is there
      result.metatile.tiles.push_back(std::move(*tile));
      ++result.counts.copied;
    });
  }
  const bool empty = result.metatile.tiles.empty();
  // A key that no map holds gives the picture of nothing.
  result.metatile.top = {work.old.picture(empty ? TileKey{kMaxZoom, 0, 0} : key),
                         empty ? InputShares{} : work.layers.of_old(key)};
  return result;
}

}  // namespace

UpdateCounts& UpdateCounts::operator+=(const UpdateCounts& other) {
  copied += other.copied, reencoded += other.reencoded, added += other.added, dropped += other.dropped;
  return *this;
}

EncodedTile copy_or_encode(const UpdateWork& work, const TileKey& key, const TileCanvas& tile, bool stays,
                           UpdateCounts& counts) {
  if (stays) {
    if (std::optional<EncodedTile> copied = work.old.copy(key)) {
      ++counts.copied;
      return std::move(*copied);
    }
  }
  ++(work.old.sidecar(key) != nullptr ? counts.reencoded : counts.added);
  return work.encoder.encode(key, tile);
}

UpdatedMetatile update_metatile(const TileKey& key, const UpdateWork& work, std::span<const LayerReader> readers) {
  if (!work.layers.may_touch(key)) return copy_metatile(key, work);
  const int finest = work.range.zoom;
  MetatileCanvas canvas = compose_metatile(key, work.range, readers, work.feather_px);
  std::set<TileKey> changed;
  const TileKey first{static_cast<std::uint8_t>(finest), key.x << (finest - key.z), key.y << (finest - key.z)};
  for_each_key(key, finest, [&](const TileKey& tile_key) {
    InputShares& used = canvas.used.at(static_cast<int>(tile_key.x - first.x), static_cast<int>(tile_key.y - first.y));
    used = work.layers.by_input(tile_key, used);
    const bool touched =
        std::any_of(used.begin(), used.end(), [&](const auto& share) { return work.layers.is_new(share.first); });
    if (touched) changed.insert(tile_key);
  });
  if (changed.empty()) return copy_metatile(key, work);

  UpdatedMetatile result;
  result.changed = true;
  result.metatile.top =
      cut_metatile(key, finest, std::move(canvas), [&](const TileKey& tile_key, const TileCanvas& tile) {
        const bool stays = !changed.contains(tile_key);
        if (!stays) changed.insert(tile_key.parent());
        result.metatile.tiles.push_back(copy_or_encode(work, tile_key, tile, stays, result.counts));
      });
  return result;
}

}  // namespace nadir
