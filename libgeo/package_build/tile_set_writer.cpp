#include "package_build/tile_set_writer.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <set>

#include "package/sidecar.hpp"
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

// Widened to whole tiles of the coarsest zoom, so that each zoom's picture begins with a tile.
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

}  // namespace nadir
