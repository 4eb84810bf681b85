// A painted land, a map of it that is out of date, and segments of flights over it: for tests and the bench of the
// placement of segments.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "flights/segment_placement.hpp"
#include "geodesy/angles.hpp"
#include "imagery/tile_source.hpp"
#include "vision/synthetic_ground.hpp"

namespace nadir::test {

struct WorldOptions {
  double half_side_m = 600;
  double changed_share = 0;  // of the land's squares of 40 m, that the map shows as they were: as another land
  double noise = 0;          // of the camera, grey levels, 1-sigma
  double relief_m = 0;       // 1-sigma of the ground's height, which no map shows, in waves of some 600 m
  double tilt_sigma_rad = 0.5 * kPi / 180;  // of the measured pitch and roll; camera.yaml states 1 degree
};

// Where the map lacks the land.
enum class MapHole {
  none,
  blank,      // no tiles around the segment
  other_land  // the whole map is of another land
};

class SegmentWorld {
 public:
  SegmentWorld(std::uint64_t seed, const WorldOptions& options);
  ~SegmentWorld();

  struct Segment {
    std::vector<CameraPose> truth;
    std::vector<cv::Mat> images;
    std::vector<ObservedFrame> observed;
    SegmentShape shape;
  };
  // So many frames, 25 m apart, along a gentle curve from a place and a heading that the number decides. The telemetry
  // knows headings, or not.
  Segment segment(int number, int frames, bool heading_known = true) const;

  std::unique_ptr<TileSource> map(MapHole hole, const Segment& segment) const;
  const LocalFrame& frame() const;
  const CameraFile& camera() const;
  PlaneBox area() const;

  // Runs to its end.
  SegmentPlacementResult place(const Segment& segment, MapHole hole, const std::vector<PlaceStatement>& stated = {},
                               const std::optional<PlaceStatement>& predicted = {}) const;

  struct Land;

 private:
  std::unique_ptr<Land> land_;
};

}  // namespace nadir::test
