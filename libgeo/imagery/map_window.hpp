// Map windows: north-up images of the map in local metres, resampled from tiles at any ground sample distance (GSD).
//
// Row 0 is the northern edge; the centre of pixel (column c, row r) lies at
//   east  = west_m  + (c + 0.5) · gsd_m
//   north = north_m − (r + 0.5) · gsd_m
// in the plane of the LocalFrame that it was read with.
#pragma once

#include <cstddef>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>

#include "geodesy/local_frame.hpp"
#include "geodesy/region.hpp"
#include "imagery/codecs.hpp"
#include "imagery/tile_source.hpp"

namespace nadir {

struct MapWindow {
  cv::Mat image;  // CV_8UC1 (grey) or CV_8UC3 (BGR)
  cv::Mat mask;   // CV_8UC1: 255 where the map has pixels, 0 elsewhere
  double west_m = 0;
  double north_m = 0;
  double gsd_m = 1;
  std::optional<double> ce90_m;  // the worst that a tile shown here states; nullopt where none states any

  PlanePoint plane_from_pixel(double column, double row) const {  // continuous: the centre of a pixel is at +0.5
    return {west_m + column * gsd_m, north_m - row * gsd_m};
  }
  cv::Point2d pixel_from_plane(PlanePoint point) const {
    return {(point.east_m - west_m) / gsd_m, (north_m - point.north_m) / gsd_m};
  }
};

// Reads windows one after the other and caches the most recently decoded tiles, so that neighbouring windows are cheap.
// Not thread-safe: each thread takes a reader of its own. The tiles must outlive it.
class MapWindowReader {
 public:
  // 256 tiles are 16 MiB in grey, 48 MiB in colour.
  explicit MapWindowReader(const TileSource& tiles, std::size_t max_cached_tiles = 256);
  ~MapWindowReader();
  MapWindowReader(MapWindowReader&&) noexcept;
  MapWindowReader& operator=(MapWindowReader&&) noexcept;

  ZoomRange zooms() const;
  // As read_map_window().
  MapWindow read(const LocalFrame& frame, const PlaneBox& box, double gsd_m, Colour colour);
  // The worst CE90 that the tiles beneath the box state, of the zoom that a window of this GSD is read from.
  std::optional<double> ce90_m(const LocalFrame& frame, const PlaneBox& box, double gsd_m) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Reads the tiles of the zoom whose pixels are the coarsest that are not coarser than gsd_m (or the finest there is),
// averages where it shrinks, and leaves mask 0 where tiles are missing or transparent. Throws Error for a box or GSD
// that does not give a window of 1 to 20000 pixels a side, and for tiles that do not decode.
MapWindow read_map_window(const TileSource& tiles, const LocalFrame& frame, const PlaneBox& box, double gsd_m,
                          Colour colour);

}  // namespace nadir
