#include "package_build/update_place_index.hpp"

#include "base/error.hpp"
#include "package/tile_container.hpp"
#include "vision/place_index_builder.hpp"

namespace nadir {

PlaceTable old_place_table(const std::filesystem::path& package, const Manifest& manifest) {
  if (const std::optional<PlaceIndex> index = PlaceIndex::open(package, manifest)) return index->table();
  throw UsageError({.what = "the old package has no place index that could be made anew",
                    .where = package,
                    .expected = std::string(kPlaceTableFile),
                    .found = "none",
                    .fix = "leave --index away, and make one afterwards: nadir cache index NEW --camera FILE.yaml"});
}

PlaceIndex remake_place_index(const PlaceTable& old, const std::filesystem::path& tiles, const TileSet& set,
                              LonLat origin, int threads, Progress& progress) {
  PlaceIndexOptions options;
  options.overlap_percent = static_cast<int>(old.overlap_percent);
  options.threads = threads;
  for (const PlaceLayer& layer : old.layers) {
    options.footprints_m.push_back(layer.side_m());
    options.sides_px.push_back(layer.side_px);
  }
  const std::unique_ptr<TileSource> source = open_tile_source(tiles);
  IndexedMap map{source.get(), {}, set.facts.merkle_root, origin};
  for (const Sidecar& sidecar : set.sidecars) {
    if (sidecar.key.z == set.facts.zoom.max) map.keys.push_back(sidecar.key);
  }
  return build_place_index(map, options, progress);
}

}  // namespace nadir
