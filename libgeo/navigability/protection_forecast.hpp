// Which protection level will the flight have? Flown many times in advance, with the belief that flies.
//
// The level of an aircraft (estimation/belief.hpp) is that of a mixture: the track, other places, and elsewhere. It is
// small where looks have agreed, whatever they were likely to do; and it is large for three reasons, none of which a
// mean over the looks knows:
//
//   start    a given start is wrong with a chance of 3e-3, far above the integrity risk. Until looks at different
//            ground have agreed there is no level, or one that holds the start's whole Gaussian as well
//   misses   between accepted looks the position grows by the velocity's σ, and by odometry's drift where frames
//            overlap
//   doubt    a wide prediction, a weak look, a turn or a frame that breaks the track leaves weight beside the track
//            until the next good looks
//
// So a flight is drawn look by look, and the level is read from its own PlaceBelief. Drawn are:
//
//   found    P of the looks (look_model.hpp) anchor. Neighbouring looks see the same ground: one latent variable with
//            the correlation exp(-way / kLookCorrelation_m) decides, z ~ N(0, 1), u = Φ(z). m = logit P - logit u is
//            how easily the place is found: it is the candidate while m > -m_0, and weak where m < 0
//   ln ℓ     of a place that was found: a + b m + c w, w ~ N(0, 1), within the table's limit
//   chance   a look that finds nothing has, once in so many times, a chance peak anywhere in its window
//
// The filter is one axis of the flight filter (flight_filter.hpp), the same for both: position, velocity and
// odometry's drift d,
//
//   p' = p + Δt v + w_p      w: the accelerometer's noise, its tilt, and in a turn Δψ the heading's error times V Δψ
//   v' = v + w_v
//   d' = d
//
// measured by accepted looks, z = p + r, and, where neighbouring frames overlap, by odometry, z = p' - p + way d + r.
// Over bare ground (look_model.hpp) odometry does not track. A flight whose search window would be wider than the
// localizer's widest is lost: from then on the localizer searches the whole area, which this forecast does not count
// on.
//
// How far off it is, is drawn as well: the start's velocity is not known at all, so that the second look finds its
// place a step away from the prediction.
//
// What is stated is a quantile over the drawn flights: the level that nine of ten stay below, none where one in ten has
// none. Numbers: navigability_parameters.hpp; the belief's and the filter's own: localizer_parameters.hpp.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "base/progress.hpp"
#include "geodesy/plane_point.hpp"
#include "geodesy/region.hpp"
#include "vision/camera.hpp"

namespace nadir {

struct ForecastFrame {
  PlanePoint place;
  double agl_m = 0;
  double along_m = 0;      // the frame on the ground: in the direction of flight …
  double footprint_m = 0;  // … and its side
  double fine_gsd_m = 0;   // that patches are matched at
  double map_sigma_m = 0;
  double seconds = 0;  // since the frame before
  double way_m = 0;    // likewise
  double turn_rad = 0;
  double probability = 0;  // that the look finds its place
  bool bare = false;       // ground without structure: odometry does not track either
};

struct ForecastSetup {
  TelemetryUncertainty uncertainty;
  double integrity_risk = 1e-5;
  double alert_limit_m = 100;
  PlaneBox area;  // where the belief looks for the aircraft: the mission's
  int threads = 1;
};

struct ForecastLevel {
  std::optional<double> hpl_m;  // nine flights of ten stay below; nothing: too many have none
  double beyond_share = 0;      // of the flights: the level is beyond the alert limit, or there is none
  double anchored_share = 0;    // of the flights: this look anchors
  double since_anchor_m = 0;    // in nine flights of ten at most
};

// One for each frame. Throws Interrupted by way of progress. The result does not depend on the number of threads.
std::vector<ForecastLevel> forecast_levels(std::span<const ForecastFrame> frames, const ForecastSetup& setup,
                                           Progress& progress);

}  // namespace nadir
