#include "package_build/update_tile_set.hpp"

#include <set>

#include "base/ordered_work.hpp"
#include "package_build/build_plan.hpp"
#include "raster/one_opencv_thread.hpp"
#include "package_build/overview_assembler.hpp"

namespace nadir {

UpdatedTileSet update_tile_set(const Mission& mission, const OldMap& old, const UpdateLayers& layers,
                               const TileRange& range, const TileSetOptions& options, const std::filesystem::path& file,
                               Progress& progress) {
  const OneOpenCvThread one_thread;
  const TileEncoder encoder(mission, layers.inputs(), options.encoding);
  const UpdateWork work{old, layers, range, encoder, feather_pixels(mission, options.mosaic)};
  const std::vector<TileKey> tops = metatiles_of(mission, range);
  TileSetWriter writer(options.container, file, mission, range, options.encoding.format);
  UpdateCounts counts;
  std::set<TileKey> changed;  // overviews above the metatiles
  OverviewAssembler overviews(tops, mission.zoom.min, [&](const TileKey& key, const TileCanvas& overview) {
    const bool stays = !changed.contains(key);
    if (!stays) changed.insert(key.parent());
    writer.add(copy_or_encode(work, key, overview, stays, counts));
  });

  progress.begin("updating tiles", tops.empty() ? 0 : count_tiles(tops, range, range.zoom).back().tiles, "tiles");
  work_in_order<UpdatedMetatile>(
      tops.size(), options.threads,
      [&]() -> std::function<UpdatedMetatile(std::size_t)> {
        return [&, readers = layers.readers()](std::size_t item) { return update_metatile(tops[item], work, readers); };
      },
      [&](std::size_t item, UpdatedMetatile updated) {
        std::uint64_t finest = 0;
        for (EncodedTile& tile : updated.metatile.tiles) {
          finest += tile.sidecar.key.z == range.zoom ? 1U : 0U;
          writer.add(std::move(tile));
        }
        counts += updated.counts;
        if (updated.changed) changed.insert(tops[item].parent());
        overviews.add(tops[item], updated.metatile.top);
        progress.advance(finest);
        return !writer.over_budget();
      });
  progress.end();
  counts.dropped = old.sidecars().size() - counts.copied - counts.reencoded;
  return {writer.finish(range, options.encoding.format), counts};
}

}  // namespace nadir
