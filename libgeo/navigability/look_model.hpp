// How likely is a look at the map to anchor, over this ground, at this height, with this camera?
//
// The map is asked (vision/matchability.hpp): a part of it serves as the frame of another day, several times with
// another noise, at the footprint and the scale that the camera has at this height. What the probes measure goes
// through a logistic model that was fitted to frames of simulated flights:
//
//   P = 1 / (1 + exp(-(b0 + b1 ratio + b2 ln(footprint / pixel of the map))))
//
// ratio: the mean over the probes, of the best score elsewhere over the score here; the score itself says nothing more
// beside it. A frame of which the map shows too little has P = 0, and so has one in which nothing correlates with
// itself. Coefficients and where they come from: kLook… in navigability_parameters.hpp; how well they do on flights
// that they were not fitted to: docs/benchmarks.md.
#pragma once

#include <cstdint>

#include "geodesy/local_frame.hpp"
#include "imagery/tile_source.hpp"
#include "vision/camera.hpp"
#include "vision/matchability.hpp"

namespace nadir {

struct ProbedGround {
  double footprint_m = 0;  // side of the square with the area of the frame
  double gsd_m = 0;        // that is matched at
  double map_gsd_m = 0;
  double valid = 0;  // share of the footprint that the map shows
  double ratio = 2;
  double log_score = 0;
  double texture = 0;

  bool operator==(const ProbedGround&) const = default;
};

// Nothing there correlates, not even with the same ground: water, snow. Nothing can be matched or tracked.
bool is_bare(const ProbedGround& look);

double anchor_probability(const ProbedGround& look);

// Probes of the map for one camera; heights within some percent of each other share theirs. One for each thread.
class LookProbes {
 public:
  // typical_texture: of the map, as typical_texture() finds it.
  LookProbes(const TileSource& tiles, const LocalFrame& frame, const CameraModel& camera, double search_m,
             double typical_texture);
  ~LookProbes();
  LookProbes(LookProbes&&) noexcept;

  // The same place and height give the same features. agl_m: above 0.
  ProbedGround look(LonLat place, double agl_m);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// The median texture of footprints at the places, which the probes' noise is relative to.
double typical_texture(const TileSource& tiles, const LocalFrame& frame, const CameraModel& camera, double agl_m,
                       const std::vector<LonLat>& places);

}  // namespace nadir
