// What a desk's packages can be made of: rasters of imagery, elevation models, cameras and keys, as the person who
// started the desk named them. Callers name them by the names of their files; no other file can be reached.
#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/time.hpp"
#include "geodesy/web_mercator.hpp"
#include "imagery/tile_source.hpp"

namespace nadir {

struct MapSourceOptions {
  // Files, or folders whose files are taken. What does not exist is left out of a listing.
  std::vector<std::filesystem::path> imagery, elevation, cameras, vectors;
  // Of all vectors that are not OpenStreetMap's own files, which state theirs (package_build/vector_source.hpp).
  std::optional<std::string> vectors_attribution, vectors_licence;
  std::vector<std::filesystem::path> keys;     // private keys: only the commands that sign read them
  std::optional<std::filesystem::path> trust;  // root that aircraft hold
};

struct ImagerySource {
  std::string name;
  std::filesystem::path path;
  LonLatBox bounds;
  ZoomRange zooms;  // of its tiles
  double pixel_m = 0;
  std::optional<UtcTime> captured_at;  // and the rest: of the STAC Item beside it
  double gsd_m = 0, ce90_m = 0;
  std::string provider;
  std::string licence;  // "license" of the item's properties (STAC 1.1); empty: it does not say
  std::string problem;  // why no package can be made of it
};

struct NamedSource {
  std::string name;
  std::filesystem::path path;
  std::string problem;
};

struct KeySource {
  std::string name;
  std::filesystem::path path;
  std::string keyid;
  std::optional<bool> appointed;  // as a package signer, by the root; none without a root
  std::string problem;
};

class MapSources {
 public:
  explicit MapSources(MapSourceOptions options);

  // Each is looked at once, and again when its file has changed.
  std::vector<ImagerySource> imagery() const;
  std::vector<NamedSource> elevation() const;
  std::vector<NamedSource> cameras() const;
  std::vector<NamedSource> vectors() const;  // roads, water, woods and buildings
  std::vector<KeySource> keys() const;       // as of `now`
  const std::optional<std::filesystem::path>& trust() const { return options_.trust; }

  std::optional<std::filesystem::path> imagery_file(std::string_view name) const;
  std::optional<std::filesystem::path> elevation_file(std::string_view name) const;
  std::optional<std::filesystem::path> camera_file(std::string_view name) const;
  std::optional<std::filesystem::path> vectors_file(std::string_view name) const;
  const MapSourceOptions& options() const { return options_; }
  std::optional<std::filesystem::path> key_file(std::string_view name) const;

  // The raster as map tiles, straight from the file; null where there is none of this name, or it cannot be read.
  std::shared_ptr<const TileSource> tiles(std::string_view name) const;

 private:
  struct Seen;
  const MapSourceOptions options_;
  mutable std::mutex mutex_;
  mutable std::map<std::filesystem::path, std::shared_ptr<const Seen>> seen_;
};

}  // namespace nadir
