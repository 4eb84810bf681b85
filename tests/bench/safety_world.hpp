// Synthetic worlds in memory: the ground on the day of the flight, the satellite image of another season, the same
// years older, and each of them as map tiles. Positions are metres in the plane of frame(), (0, 0) in the world's
// middle.
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <opencv2/core/mat.hpp>

#include "geodesy/local_frame.hpp"
#include "imagery/tile_source.hpp"
#include "simulation/landscape.hpp"
#include "vision/ground_surface.hpp"

namespace nadir::bench {

inline constexpr double kWorldSide_m = 1800;
inline constexpr double kWorldGsd_m = 0.6;
inline constexpr int kMapZoom = 17;  // 0.79 m

const LocalFrame& frame();

// Where a position lies in an image, 8 bit BGR, north up, whose middle is (0, 0); pixel centres at +0.0, as OpenCV
// resamples.
cv::Point2d pixel_of(PlanePoint place, cv::Size size, double gsd_m);
cv::Point2d pixel_of(PlanePoint place);  // in an image of a whole world

class Terrain final : public GroundSurface {
 public:
  explicit Terrain(const Relief& relief);
  double height_m(PlanePoint point) const override;
  double relief_sigma_m() const override { return 1.5; }  // roofs and trees, which the elevation model does not have

 private:
  const Relief& relief_;
  double level_m_;
};

TileKey tile_under(PlanePoint place);

// How an image becomes a map.
enum class MapOrientation {
  as_it_is,
  mirrored,      // east is west
  quarter_turn,  // east is north
};
struct MapPlacement {
  double gsd_m = kWorldGsd_m;  // of the image
  int zoom = kMapZoom;
  PlanePoint shift{};  // what lies at p appears at p + shift
  MapOrientation orientation = MapOrientation::as_it_is;
};

// An image as tiles, encoded on first use. Safe for several threads.
class PictureTiles final : public TileSource {
 public:
  // The image must outlive the tiles.
  explicit PictureTiles(const cv::Mat& picture, const MapPlacement& placement = {})
      : picture_(picture), placement_(placement) {}

  ZoomRange zooms() const override { return {placement_.zoom, placement_.zoom}; }
  std::optional<Bytes> read(const TileKey& key) const override;

 private:
  std::optional<Bytes> cut(const TileKey& key) const;

  const cv::Mat& picture_;
  MapPlacement placement_;
  mutable std::mutex mutex_;
  mutable std::map<TileKey, std::optional<Bytes>> known_;
};

// A line across the world; the tiles beyond it belong to another image.
struct Border {
  PlanePoint at, towards;  // towards: any length

  bool beyond(PlanePoint place) const {
    return (place.east_m - at.east_m) * towards.east_m + (place.north_m - at.north_m) * towards.north_m > 0;
  }
  bool beyond(const TileKey& key) const;  // by its middle
};

// Two maps as one. Both must outlive it.
class JoinedTiles final : public TileSource {
 public:
  JoinedTiles(const TileSource& near, const TileSource& far, const Border& border)
      : near_(near), far_(far), border_(border) {}
  ZoomRange zooms() const override { return near_.zooms(); }
  std::optional<Bytes> read(const TileKey& key) const override {
    return (border_.beyond(key) ? far_ : near_).read(key);
  }

 private:
  const TileSource &near_, &far_;
  Border border_;
};

// The images of one seed. Not movable: its parts point at each other.
struct World {
  explicit World(std::uint64_t seed);

  Landscape land;
  cv::Mat day, satellite;
  Terrain terrain;
  double map_sigma_m;
  PictureTiles map, mirrored_map;
};

// The satellite image with half of the ground rebuilt: parts of another world.
cv::Mat outdated(const World& world, const World& donor, std::uint64_t seed);

// The seed of a bench's first world. Base seeds from a million on judge: over worlds that nothing was fitted to.
std::uint64_t first_world_of(std::uint64_t base_seed);

// As many as asked for, of consecutive seeds, and an outdated map of each.
struct Worlds {
  explicit Worlds(int count, std::uint64_t first_seed = 1);
  const World& neighbour(std::size_t i) const { return *all[(i + 1) % all.size()]; }

  std::vector<std::unique_ptr<World>> all;
  std::vector<cv::Mat> old_pictures;
  std::vector<std::unique_ptr<PictureTiles>> old_maps;
};

}  // namespace nadir::bench
