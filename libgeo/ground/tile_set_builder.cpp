#include "ground/tile_set_builder.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <opencv2/core/utility.hpp>
#include <optional>
#include <set>

#include "base/error.hpp"
#include "ground/metatile_record.hpp"
#include "ground/ordered_work.hpp"
#include "ground/overview_assembler.hpp"
#include "imagery/mbtiles_writer.hpp"
#include "package/sidecar_table.hpp"
#include "trust/merkle.hpp"

namespace nadir {
namespace {

constexpr int kMetatileSteps = 3;  // 8 x 8 tiles: 2048 pixels a side, 16 MiB

// Our threads share the work out already; OpenCV's own below each of them would only get in the way.
class OneOpenCvThread {
 public:
  OneOpenCvThread() : before_(cv::getNumThreads()) { cv::setNumThreads(1); }
  ~OneOpenCvThread() { cv::setNumThreads(before_); }
  OneOpenCvThread(const OneOpenCvThread&) = delete;
  OneOpenCvThread& operator=(const OneOpenCvThread&) = delete;

 private:
  int before_;
};

std::uint64_t along_curve(const TileKey& key) {  // Morton order: neighbours in the plane stay near in the sequence
  std::uint64_t code = 0;
  for (unsigned bit = 0; bit < kMaxZoom; ++bit) {
    code |= (std::uint64_t{(key.x >> bit) & 1U} << (2 * bit)) | (std::uint64_t{(key.y >> bit) & 1U} << (2 * bit + 1));
  }
  return code;
}

std::vector<TileKey> metatiles_of(const TileRange& range, int min_zoom) {
  const TileRange tops = range.at_zoom(std::max(min_zoom, range.zoom - kMetatileSteps));
  std::vector<TileKey> keys;
  for (std::int64_t y = tops.first_y; y <= tops.last_y; ++y) {
    for (std::int64_t x = tops.first_x; x <= tops.last_x; ++x) {
      keys.push_back(
          {static_cast<std::uint8_t>(tops.zoom), static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(y)});
    }
  }
  std::sort(keys.begin(), keys.end(),
            [](const TileKey& a, const TileKey& b) { return along_curve(a) < along_curve(b); });
  return keys;
}

std::map<std::string, std::string> metadata_of(const Mission& mission, const TileRange& range, const TileSet& set,
                                               ImageFormat format) {
  const LonLatBox first = bounds_of({static_cast<std::uint8_t>(range.zoom), static_cast<std::uint32_t>(range.first_x),
                                     static_cast<std::uint32_t>(range.first_y)});
  const LonLatBox last = bounds_of({static_cast<std::uint8_t>(range.zoom), static_cast<std::uint32_t>(range.last_x),
                                    static_cast<std::uint32_t>(range.last_y)});
  std::set<std::string> sources;
  for (const Sidecar& sidecar : set.sidecars) sources.insert(sidecar.source);
  return {
      {"name", mission.id},
      {"format", format == ImageFormat::jpeg ? "jpg" : std::string(name_of(format))},
      {"type", "baselayer"},
      {"version", std::to_string(mission.sequence)},
      {"description", fmt::format("Map of mission {} for nadir", mission.id)},
      {"attribution", fmt::format("{}", fmt::join(sources, ", "))},
      {"minzoom", std::to_string(mission.zoom.min)},
      {"maxzoom", std::to_string(mission.zoom.max)},
      {"bounds",
       fmt::format("{:.7f},{:.7f},{:.7f},{:.7f}", first.west_deg, last.south_deg, last.east_deg, first.north_deg)},
      {"center", fmt::format("{:.7f},{:.7f},{}", (first.west_deg + last.east_deg) / 2,
                             (first.north_deg + last.south_deg) / 2, mission.zoom.min)},
  };
}

TileSetFacts facts_of(const Mission& mission, const std::vector<Sidecar>& sidecars, ImageFormat format) {
  MerkleTree tree;
  SidecarDigest digest;
  for (const Sidecar& sidecar : sidecars) {
    tree.add(sidecar.key, sidecar.sha256);
    digest.add(sidecar);
  }
  return {tree.count(), tree.root(), digest.finish(), mission.zoom, std::string(name_of(format))};
}

double feather_pixels(const Mission& mission, const MosaicOptions& mosaic) {
  const double pixel_m = ground_resolution_m(mission.zoom.max, mission.takeoff.lat_deg);
  const double pixels = mosaic.feather_m / pixel_m;
  if (pixels <= kMaxFeather_px) return pixels;
  throw UsageError({.what = "seams cannot fade over so far",
                    .where = "--feather-m",
                    .expected = fmt::format("at most {:.0f} m at zoom {}", kMaxFeather_px * pixel_m, mission.zoom.max),
                    .found = fmt::format("{} m", mosaic.feather_m)});
}

}  // namespace

TileSet build_tile_set(const Mission& mission, std::span<const ImageryInput> inputs, const TileRange& range,
                       const TileSetOptions& options, const std::filesystem::path& mbtiles, BuildJournal& journal,
                       Progress& progress) {
  const OneOpenCvThread one_thread;
  const TileEncoder encoder(mission, inputs, options.encoding);
  const std::vector<TileKey> tops = metatiles_of(range, mission.zoom.min);
  const double feather_px = feather_pixels(mission, options.mosaic);
  const auto budget = static_cast<std::uint64_t>(mission.budget_mb) * 1'000'000;
  MbtilesWriter writer(mbtiles);
  TileSet set;
  const auto emit = [&](EncodedTile tile) {
    writer.add(tile.sidecar.key, tile.bytes);
    set.tile_bytes += tile.bytes.size();
    set.sidecars.push_back(std::move(tile.sidecar));
  };
  OverviewAssembler overviews(tops, mission.zoom.min, encoder, emit);

  std::size_t done = 0;  // metatiles from the journal
  progress.begin("making tiles", static_cast<std::uint64_t>(range.count()), "tiles");
  const auto make_worker = [&]() -> std::function<Metatile(std::size_t)> {
    auto sources = std::make_shared<std::vector<RasterSource>>();
    for (const ImageryInput& input : inputs) sources->emplace_back(input.path);
    return [&, sources](std::size_t item) {
      return render_metatile(tops[done + item], range, *sources, feather_px, encoder);
    };
  };
  const auto take = [&](std::size_t item, Metatile metatile) {
    std::uint64_t finest = 0;
    for (EncodedTile& tile : metatile.tiles) {
      finest += tile.sidecar.key.z == range.zoom ? 1U : 0U;
      emit(std::move(tile));
    }
    overviews.add(tops[item], metatile.top);
    progress.advance(finest);
    set.over_budget = set.tile_bytes > budget;
    return finest;
  };
  while (const auto record = journal.next()) {
    std::optional<Metatile> metatile = metatile_from(*record);
    if (!metatile || done == tops.size()) {
      throw Error({.what = "the journal of the build that was begun is of no use",
                   .where = mbtiles.string(),
                   .fix = "build from the start, without --resume"});
    }
    set.resumed += take(done++, std::move(*metatile));
    if (set.over_budget) break;
  }
  if (!set.over_budget) {
    work_in_order<Metatile>(tops.size() - done, options.threads, make_worker, [&](std::size_t item, Metatile metatile) {
      journal.add(record_of(metatile));
      take(done + item, std::move(metatile));
      return !set.over_budget;
    });
  }
  progress.end();
  if (set.over_budget) return set;

  std::sort(set.sidecars.begin(), set.sidecars.end(), [](const Sidecar& a, const Sidecar& b) { return a.key < b.key; });
  {
    SidecarWriter sidecars(writer.database());
    for (const Sidecar& sidecar : set.sidecars) sidecars.add(sidecar);
  }
  writer.set_metadata(metadata_of(mission, range, set, options.encoding.format));
  writer.finish();
  set.facts = facts_of(mission, set.sidecars, options.encoding.format);
  return set;
}

}  // namespace nadir
