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

TileSet build_tile_set(const Mission& mission, std::span<const ImageryInput> inputs, const TileRange& range,
                       const TileSetOptions& options, const std::filesystem::path& file, BuildJournal& journal,
                       Progress& progress) {
  const SingleOpenCvThread one_thread;
  const TileEncoder encoder(mission, inputs, options.encoding);
  const std::vector<TileKey> tops = metatiles_of(mission, range);
  const double feather_px = feather_pixels(mission, options.mosaic);
  TileSetWriter writer(options.container, file, mission, range, options.encoding.format);
  OverviewAssembler overviews(tops, mission.zoom.min, [&](const TileKey& key, const TileCanvas& overview) {
    writer.add(encoder.encode(key, overview));
  });

  std::size_t done = 0;       // metatiles from the journal
  std::uint64_t resumed = 0;  // tiles of the finest zoom in them
  std::size_t taken = 0;      // metatiles, from there and made
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
    ++taken;
    return finest;
  };
  while (const auto record = journal.next()) {
    std::optional<Metatile> metatile = parse_metatile(*record);
    if (!metatile || done == tops.size()) {
      throw Error({.what = "the journal of the interrupted build cannot be used",
                   .where = file.string(),
                   .fix = "build from the start, without --resume"});
    }
    resumed += take(done++, std::move(*metatile));
    if (writer.over_budget()) break;
  }
  if (!writer.over_budget()) {
    work_in_order<Metatile>(tops.size() - done, options.threads, make_worker, [&](std::size_t item, Metatile metatile) {
      journal.add(serialize_metatile(metatile));
      take(done + item, std::move(metatile));
      return !writer.over_budget();
    });
  }
  progress.end();
  TileSet set = writer.finish(range, options.encoding.format);
  set.resumed = resumed;
  if (set.over_budget && taken > 0) set.expected_bytes = set.tile_bytes * tops.size() / taken;
  return set;
}

}  // namespace nadir
