// How a frame compares with the map where its segment was placed as a whole.
//
// In flight such a frame was compared with another part of the map, or with none: what is stored of that look says
// nothing about the place that holds now. So the frame is compared again, when somebody asks, by the matcher that the
// flight was localized with, in a window around its pose as view_of() has it. It changes nothing.
//
//   accepted        agrees with the placement within 99.9 %
//   off_prediction  something else looks more like it
//   the others      as in flight (estimation/map_look.hpp)
#pragma once

#include <cstddef>
#include <deque>
#include <memory>
#include <mutex>
#include <string>

#include "base/bytes.hpp"
#include "desk/frame_geometry.hpp"
#include "estimation/estimate.hpp"
#include "flights/flight_store.hpp"

namespace nadir {

struct PlacedLook {
  AnchorReport report;  // without its images
  Bytes seen, map;      // JPEG; empty where nothing was matched
};

// Keeps the last few looks: a page asks for each and, separately, for its two images. Safe from several threads; one
// look is made at a time, because a matcher takes a processor and memory.
class PlacedLooks {
 public:
  // Null: the frame belongs to no segment that was placed as a whole, or its map cannot be used. Throws Error when the
  // picture cannot be read.
  std::shared_ptr<const PlacedLook> of(const std::string& flight, const FlightStore& store, const FlightGround& ground,
                                       std::size_t frame);

 private:
  struct Kept {
    std::string flight;
    std::size_t frame;
    CameraPose pose;  // another one: another look
    std::shared_ptr<const PlacedLook> look;
  };

  std::mutex mutex_;
  std::deque<Kept> kept_;
};

}  // namespace nadir
