#include "package_build/tile_set_builder.hpp"

#include <optional>

#include "base/error.hpp"
#include "base/ordered_work.hpp"
#include "package_build/build_plan.hpp"
#include "package_build/metatile_record.hpp"
#include "raster/one_opencv_thread.hpp"
#include "package_build/overview_assembler.hpp"

namespace nadir {

TileSet build_tile_set(const Mission& mission, std::span<const ImageryInput> inputs, const TileRange& range,
                       const TileSetOptions& options, const std::filesystem::path& file, BuildJournal& journal,
                       Progress& progress) {
  const OneOpenCvThread one_thread;
  const TileEncoder encoder(mission, inputs, options.encoding);
  const std::vector<TileKey> tops = metatiles_of(mission, range);
  const double feather_px = feather_pixels(mission, options.mosaic);
  TileSetWriter writer(options.container, file, mission, range, options.encoding.format);
  OverviewAssembler overviews(tops, mission.zoom.min, [&](const TileKey& key, const TileCanvas& overview) {
    writer.add(encoder.encode(key, overview));
  });

  std::size_t done = 0;       // metatiles from the journal
  std::uint64_t resumed = 0;  // tiles of the finest zoom in them
  progress.begin("making tiles", tops.empty() ? 0 : count_tiles(tops, range, range.zoom).back().tiles, "tiles");
  const auto make_worker = [&]() -> std::function<Metatile(std::size_t)> {
    auto sources = std::make_shared<std::vector<RasterSource>>();
    for (const ImageryInput& input : inputs) sources->emplace_back(input.path, input.stretch);
    return [&, sources, layers = layers_of(*sources)](std::size_t item) {
      return render_metatile(tops[done + item], range, layers, feather_px, encoder);
    };
  };
  const auto take = [&](std::size_t item, Metatile metatile) {
    std::uint64_t finest = 0;
    for (EncodedTile& tile : metatile.tiles) {
      finest += tile.sidecar.key.z == range.zoom ? 1U : 0U;
      writer.add(std::move(tile));
    }
    overviews.add(tops[item], metatile.top);
    progress.advance(finest);
    return finest;
  };
  while (const auto record = journal.next()) {
    std::optional<Metatile> metatile = metatile_from(*record);
    if (!metatile || done == tops.size()) {
      throw Error({.what = "the journal of the build that was begun is of no use",
                   .where = file.string(),
                   .fix = "build from the start, without --resume"});
    }
    resumed += take(done++, std::move(*metatile));
    if (writer.over_budget()) break;
  }
  if (!writer.over_budget()) {
    work_in_order<Metatile>(tops.size() - done, options.threads, make_worker, [&](std::size_t item, Metatile metatile) {
      journal.add(record_of(metatile));
      take(done + item, std::move(metatile));
      return !writer.over_budget();
    });
  }
  progress.end();
  TileSet set = writer.finish(range, options.encoding.format);
  set.resumed = resumed;
  return set;
}

}  // namespace nadir
