// From where a frame was taken, as well as it is known now; and what follows from it for a person's help: the frame's
// footprint, where the aircraft was when a point of the picture is on the map, and where a marked object is.
//
// Once the flight is adjusted: position, attitude and height of its frames as adjusted, their covariances, and the
// adjusted lens. Otherwise the position is of the best estimates that there are; heading and height are of the filter,
// as the frame was processed, or of the segment as it was placed; pitch and roll are as they were measured, otherwise
// level. Their sigmas are of the filter, and of camera.yaml.
//
// A pixel q of a frame with attitude R shows the direction d = R ray(q). On level ground h below the camera that is the
// offset o = (h / -d_up) (d_east, d_north). A person who finds q at place g says that the aircraft was at g - o, with
//   σ² = σ_g² + (|o| σ_heading)² + ((h + |o|² / h) σ_tilt)² + (|o| σ_h / h)².
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "adjustment/object_place.hpp"
#include "desk/package_registry.hpp"
#include "flights/flight_store.hpp"
#include "geodesy/local_frame.hpp"
#include "vision/ground_surface.hpp"

namespace nadir {

// The plane of a flight's estimates, and the ground in it.
class FlightGround {
 public:
  // package: null for a flight without a map, or while it cannot be used; the ground is flat then.
  FlightGround(const FlightStore& store, std::shared_ptr<const DeskPackage> package);

  const LocalFrame& plane() const { return plane_; }
  const GroundSurface& surface() const;
  const DeskPackage* package() const { return package_.get(); }

 private:
  std::shared_ptr<const DeskPackage> package_;
  LocalFrame plane_;
  FlatGround flat_;
};

struct FrameView {
  SightedFrame camera;  // in the plane; at its origin where the position is not known
  CameraModel lens;     // of the picture in its full size
  bool placed = false;
  bool adjusted = false;                     // all of it
  EstimateKind kind = EstimateKind::online;  // of the position
  double heading_sigma_rad = 0, tilt_sigma_rad = 0, agl_sigma_m = 0;
};

// Throws Error for a frame that has not been processed.
FrameView view_of(const FlightStore& store, const FlightGround& ground, std::size_t frame);
// The same without the adjustment of the flight: for frames that are used together with others which have none.
FrameView processed_view_of(const FlightStore& store, const FlightGround& ground, std::size_t frame);

// East and north of the camera, in metres, of what the picture's corners show on level ground: top left, top right,
// bottom right, bottom left. Nothing: a corner shows the sky.
std::optional<std::array<Eigen::Vector2d, 4>> footprint(const FrameView& view);

// Where the aircraft was when `pixel` of the frame shows `place`. Nothing: it shows the sky.
std::optional<SearchHint> aircraft_at(const FrameView& view, const PixelPoint& pixel, const LonLat& place,
                                      double sigma_m);

// A marked object on the ground, or why it has no place.
struct PlacedObject {
  LonLat place;
  double height_m = 0;  // above the plane
  LocatedObject located;
  bool adjusted = false;  // by adjusted poses
};
std::variant<PlacedObject, std::string> place_of(const MarkedObject& object, const FlightStore& store,
                                                 const FlightGround& ground);

}  // namespace nadir
