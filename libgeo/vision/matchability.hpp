// How well could a frame taken here be found on the map? Evaluated from the map alone, before any flight.
//
// The map at the place serves as the frame: it is cut out a little turned, scaled and shifted, degraded with noise as
// if taken in another season by another sensor, and correlated with the map around it as in flight
// (vision/map_search.hpp). A village is found far better than anything else fits; water, bare fields and endless rows
// of one crop are not.
#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <span>
#include <vector>

#include "imagery/map_window.hpp"
#include "imagery/matchability_raster.hpp"
#include "vision/camera.hpp"
#include "vision/localizer_parameters.hpp"

namespace nadir {

const char* name_of(MatchClass cls);

// What a flight needs to anchor (localizer_parameters.hpp); matchability_options() fills them in.
struct MatchabilityLimits {
  double good_ratio = 0;
  double weak_ratio = 0;
  double min_score = 0;
  double min_valid = 0;  // share of the footprint that the map shows
};

struct MatchabilityOptions {
  double footprint_m = kMatchabilityFootprint_m;  // side of the square that serves as the frame
  double gsd_m = kSearchGsd_m;                    // to correlate at
  double radius_m = kMatchabilityRadius_m;        // half the side of the square of places that compete
  double distinct_m = kDistinct_m;                // places closer than this are one place
  double typical_texture = 0;  // of the whole map, as PlaceMatchability::texture; the noise is relative to it
  std::uint64_t seed = 1;      // of the noise
  MatchabilityLimits limits;
};

// As a flight searches that correlates at gsd_m, within search_m around its prediction.
MatchabilityOptions matchability_options(double footprint_m, double gsd_m, double search_m);
// Side of the square with the area of a frame's footprint.
double square_footprint_m(const CameraModel& camera, double agl_m);

struct PlaceMatchability {
  MatchClass cls = MatchClass::outside;
  double ratio = 2;    // best score elsewhere / score here; above 1 another place fits better; at most 2
  double score = 0;    // here: the correlation that the noise left
  double entropy = 0;  // of the orientations of all edges: 0 one orientation, 1 all equally frequent
  double texture = 0;  // root mean square gradient, grey levels per pixel of gsd_m
  double valid = 0;    // share of the footprint that the map shows

  bool operator==(const PlaceMatchability&) const = default;
};

class MatchabilityProbe {
 public:
  explicit MatchabilityProbe(const MatchabilityOptions& options);

  const MatchabilityOptions& options() const { return options_; }

  // The ground that the window must hold: this far to all sides of the place.
  double reach_m() const;

  // Of a part of the map, without correlating; for typical_texture.
  static double texture_of(const cv::Mat& grey, const cv::Mat& mask);

  // window: grey, of options.gsd_m, reach_m() to each side of the place, which is its middle. number: of the
  // place, so that each has noise of its own. The same input gives the same result; safe from several threads.
  PlaceMatchability probe(const MapWindow& window, std::uint64_t number) const;
  // The same for each of the numbers; what the map needs is done once.
  std::vector<PlaceMatchability> probe(const MapWindow& window, std::span<const std::uint64_t> numbers) const;

 private:
  MatchabilityOptions options_;
  cv::Mat noise_;  // CV_32FC1, grey levels
};

}  // namespace nadir
