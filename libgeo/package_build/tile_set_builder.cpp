#include "package_build/tile_set_builder.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <opencv2/core.hpp>
#include <optional>
#include <set>

#include "base/error.hpp"
#include "base/ordered_work.hpp"
#include "package/sidecar.hpp"
#include "package_build/build_plan.hpp"
#include "package_build/metatile.hpp"
#include "raster/single_opencv_thread.hpp"
#include "trust/merkle.hpp"

namespace nadir {
namespace {

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

// Expanded to whole tiles of the coarsest zoom, so that the image of each zoom begins with a tile.
CogShape shape_of(const Mission& mission, const TileRange& range) {
  const TileRange tops = range.at_zoom(mission.zoom.min);
  return {mission.zoom, static_cast<std::uint32_t>(tops.first_x), static_cast<std::uint32_t>(tops.first_y),
          static_cast<std::uint32_t>(tops.last_x - tops.first_x + 1),
          static_cast<std::uint32_t>(tops.last_y - tops.first_y + 1)};
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

}  // namespace

std::string_view file_of(TileSetKind kind) { return kind == TileSetKind::cog ? kCogFile : kImageryFile; }

TileSetWriter::TileSetWriter(TileSetKind kind, std::filesystem::path file, const Mission& mission,
                             const TileRange& range, ImageFormat format)
    : mission_(mission), file_(std::move(file)) {
  if (kind == TileSetKind::cog) {
    cog_.emplace(file_, shape_of(mission, range), format);
  } else {
    mbtiles_.emplace(file_);
  }
}

void TileSetWriter::add(EncodedTile tile) {
  if (cog_) {
    cog_->add(tile.sidecar.key, tile.bytes);
  } else {
    mbtiles_->add(tile.sidecar.key, tile.bytes);
  }
  set_.tile_bytes += tile.bytes.size();
  set_.over_budget = set_.tile_bytes > static_cast<std::uint64_t>(mission_.budget_mb) * 1'000'000;
  set_.sidecars.push_back(std::move(tile.sidecar));
}

TileSet TileSetWriter::finish(const TileRange& range, ImageFormat format) {
  if (set_.over_budget) return std::move(set_);
  std::sort(set_.sidecars.begin(), set_.sidecars.end(),
            [](const Sidecar& a, const Sidecar& b) { return a.key < b.key; });
  const auto metadata = metadata_of(mission_, range, set_, format);
  if (cog_) {
    cog_->finish();
    write_sidecar_file(file_.parent_path() / std::filesystem::path(kSidecarFile).filename(), set_.sidecars, metadata);
  } else {
    {
      SidecarWriter sidecars(mbtiles_->database());
      for (const Sidecar& sidecar : set_.sidecars) sidecars.add(sidecar);
    }
    mbtiles_->set_metadata(metadata);
    mbtiles_->finish();
  }
  set_.facts = facts_of(mission_, set_.sidecars, format);
  return std::move(set_);
}

OverviewAssembler::OverviewAssembler(const std::vector<TileKey>& tops, int min_zoom, OverviewSink sink)
    : min_zoom_(min_zoom), sink_(std::move(sink)) {
  std::set<TileKey> level(tops.begin(), tops.end());
  while (!level.empty() && level.begin()->z > min_zoom) {
    std::set<TileKey> parents;
    for (const TileKey& key : level) {
      ++children_[key.parent()];
      parents.insert(key.parent());
    }
    level = std::move(parents);
  }
}

void OverviewAssembler::add(const TileKey& key, const TileCanvas& tile) {
  if (key.z <= min_zoom_) return;
  const TileKey parent_key = key.parent();
  Parent& parent = parents_[parent_key];
  if (parent.image.bgr.empty()) {
    parent.image = {cv::Mat::zeros(2 * kTileSize, 2 * kTileSize, CV_8UC3),
                    cv::Mat::zeros(2 * kTileSize, 2 * kTileSize, CV_8UC1)};
    parent.missing = children_.at(parent_key);
  }
  const cv::Rect place(static_cast<int>(key.x % 2) * kTileSize, static_cast<int>(key.y % 2) * kTileSize, kTileSize,
                       kTileSize);
  tile.image.bgr.copyTo(parent.image.bgr(place));
  tile.image.mask.copyTo(parent.image.mask(place));
  for (const auto& [input, pixels] : tile.used) parent.used[input] += pixels;
  if (--parent.missing > 0) return;
  const TileCanvas whole{halved(parent.image), parent.used};
  parents_.erase(parent_key);
  if (cv::countNonZero(whole.image.mask) > 0) sink_(parent_key, whole);
  add(parent_key, whole);
}

TilePlan::TilePlan(const Mission& mission_in, std::span<const ImageryInput> inputs_in, const TileRange& range_in,
                   const TileSetOptions& options_in)
    : mission(mission_in),
      inputs(inputs_in),
      range(range_in),
      options(options_in),
      metatiles(metatiles_of(mission_in, range_in)) {}

std::uint64_t TilePlan::finest_tiles(std::size_t first, std::size_t last) const {
  if (first == last) return 0;
  return count_tiles(std::span(metatiles).subspan(first, last - first), range, range.zoom).back().tiles;
}

namespace {

std::uint64_t finest_tiles_in(const Metatile& metatile, int finest) {
  return static_cast<std::uint64_t>(
      std::count_if(metatile.tiles.begin(), metatile.tiles.end(),
                    [&](const EncodedTile& tile) { return tile.sidecar.key.z == finest; }));
}

// Neighbours along the curve, which one thread makes: what two threads read at the border between them is decoded by
// each. With runs of one, two threads took 10 % more CPU time than one (3 km x 3 km, DEFLATE in blocks of 256 pixels).
// So many runs that all threads end at about the same time.
std::size_t metatiles_per_run(std::size_t metatiles, int threads) {
  constexpr std::size_t kMostMetatiles = 4, kRunsPerThread = 8;
  return std::clamp<std::size_t>(metatiles / (kRunsPerThread * static_cast<std::size_t>(std::max(1, threads))), 1,
                                 kMostMetatiles);
}

}  // namespace

std::uint64_t make_metatiles(const TilePlan& plan, MetatileSpan part, BuildJournal& journal, const TakeMetatile& take,
                             Progress& progress) {
  const SingleOpenCvThread one_thread;
  const TileEncoder encoder(plan.mission, plan.inputs, plan.options.encoding);
  const double feather_px = feather_pixels(plan.mission, plan.options.mosaic);
  const auto hand_on = [&](Metatile metatile) {
    const std::uint64_t finest = finest_tiles_in(metatile, plan.range.zoom);
    const bool go_on = take(std::move(metatile));
    progress.advance(finest);
    return go_on;
  };

  std::uint64_t resumed = 0;
  std::size_t done = part.first;
  while (const auto record = journal.next()) {
    std::optional<Metatile> metatile = parse_metatile(*record);
    if (!metatile || done == part.last) {
      throw Error({.what = "the journal of the interrupted build cannot be used",
                   .where = journal.path().string(),
                   .fix = "remove it and build from the start, without --resume"});
    }
    ++done;
    resumed += finest_tiles_in(*metatile, plan.range.zoom);
    if (!hand_on(std::move(*metatile))) return resumed;
  }
  using Run = std::vector<Metatile>;
  const std::size_t left = part.last - done, run_length = metatiles_per_run(left, plan.options.threads);
  const auto make_worker = [&]() -> std::function<Run(std::size_t)> {
    return [&, layers = layers_of(plan.inputs)](std::size_t run) {
      Run metatiles;
      for (std::size_t i = run * run_length; i < std::min(left, (run + 1) * run_length); ++i) {
        metatiles.push_back(render_metatile(plan.metatiles[done + i], plan.range, layers, feather_px, encoder));
      }
      return metatiles;
    };
  };
  const auto take_run = [&](std::size_t, Run metatiles) {
    return std::all_of(metatiles.begin(), metatiles.end(), [&](Metatile& metatile) {
      journal.add(serialize_metatile(metatile));
      return hand_on(std::move(metatile));
    });
  };
  work_in_order<Run>((left + run_length - 1) / run_length, plan.options.threads, make_worker, take_run);
  return resumed;
}

TileSet build_tile_set(const TilePlan& plan, const std::filesystem::path& file, BuildJournal& journal,
                       Progress& progress) {
  TileSetAssembler assembler(plan, file);
  const MetatileSpan all{0, plan.metatiles.size()};
  progress.begin("making tiles", plan.finest_tiles(all.first, all.last), "tiles");
  const std::uint64_t resumed = make_metatiles(
      plan, all, journal, [&](Metatile metatile) { return assembler.add(std::move(metatile)); }, progress);
  progress.end();
  TileSet set = assembler.finish();
  set.resumed = resumed;
  return set;
}

TileSetAssembler::TileSetAssembler(const TilePlan& plan, const std::filesystem::path& file)
    : plan_(plan),
      encoder_(plan.mission, plan.inputs, plan.options.encoding),
      writer_(plan.options.container, file, plan.mission, plan.range, plan.options.encoding.format),
      overviews_(plan.metatiles, plan.mission.zoom.min, [this](const TileKey& key, const TileCanvas& overview) {
        writer_.add(encoder_.encode(key, overview));
      }) {}

bool TileSetAssembler::add(Metatile metatile) {
  for (EncodedTile& tile : metatile.tiles) writer_.add(std::move(tile));
  overviews_.add(plan_.metatiles[taken_], metatile.top);
  ++taken_;
  return !writer_.over_budget();
}

TileSet TileSetAssembler::finish() {
  TileSet set = writer_.finish(plan_.range, plan_.options.encoding.format);
  if (set.over_budget && taken_ > 0) set.expected_bytes = set.tile_bytes * plan_.metatiles.size() / taken_;
  return set;
}

}  // namespace nadir
