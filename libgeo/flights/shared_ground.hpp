// Floating segments that show ground which a placed one shows: placed by its pictures, where the map alone cannot place
// them.
//
// The map may be too old for a whole segment, or not be there at all, while another pass over the same ground is tied
// to the map elsewhere. Two pictures of one flight look far more alike than a picture and a map, so that the front end
// of odometry (visual_odometry.hpp), which compares a frame with the one before, compares a frame of the floating
// segment with any reference: a frame whose place is known, of an anchored segment or of one that was placed as a
// whole. A match gives the frame's place, from the reference's by the motion between the two, and its heading.
//
//   compare   Pictures are compared one reference at a time with frames that are spread over the segment: references
//             nearest to where dead reckoning has the segment first, then those around a match. References are spread
//             over the ground as well, so that a flight of hours has a bounded number of them.
//   agree     All matches must agree on one similarity of the segment (segment_shape.hpp), each within 99.9 % of its
//   own
//             errors and the reference's. Look-alikes contradict the shape of the segment, or each other.
//   place     Enough frames that agree, and hardly any that contradict: the segment is merged, by the similarity that
//             they determine. The event segments_merged names the segments that it was placed by. Where a person takes
//             the placement of one of them back, this one floats again.
//
// The block adjustment (flight_adjustment.hpp) starts from here: frames that now overlap are joined by tie points.
#pragma once

#include <cstddef>
#include <memory>

#include "flights/segment_placer.hpp"

namespace nadir {

class SharedGround {
 public:
  SharedGround(FlightStore& store, const PlacerSetup& setup);
  ~SharedGround();
  SharedGround(const SharedGround&) = delete;
  SharedGround& operator=(const SharedGround&) = delete;

  // One reference with one floating segment, some tenths of a second. What was compared is not compared again. Throws
  // Interrupted when cancelled, and can be called again then.
  PlacerOutcome step(const Cancel& cancel);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace nadir
