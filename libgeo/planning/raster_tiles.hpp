// A raster as map tiles, made when they are asked for: what a planner sees before a package is built.
//
// Tiles are JPEG, or WebP with transparency where the raster does not cover them; the last ones stay in memory. Safe
// from several threads; one tile is made at a time.
#pragma once

#include <filesystem>
#include <list>
#include <map>
#include <mutex>

#include "imagery/tile_source.hpp"
#include "raster/raster_source.hpp"

namespace nadir {

class RasterTiles final : public TileSource {
 public:
  // Throws as RasterSource.
  explicit RasterTiles(const std::filesystem::path& path);

  ZoomRange zooms() const override { return zooms_; }
  LonLatBox bounds() const { return bounds_; }
  double pixel_m() const { return raster_.pixel_m(); }
  std::optional<Bytes> read(const TileKey& key) const override;

 private:
  std::optional<Bytes> made(const TileKey& key) const;

  using Kept = std::pair<TileKey, std::optional<Bytes>>;
  mutable std::mutex mutex_;
  mutable RasterSource raster_;
  ZoomRange zooms_;
  LonLatBox bounds_;
  mutable std::list<Kept> kept_;  // the one used last is the first
  mutable std::map<TileKey, std::list<Kept>::iterator> places_;
};

}  // namespace nadir
