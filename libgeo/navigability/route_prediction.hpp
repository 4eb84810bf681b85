// Where along the route would the aircraft know its position? Predicted from the package, the camera and the heights.
//
// At every frame of the planned flight: the probability that its look anchors (look_model.hpp), and the protection
// level that the integrity monitor would state. Between anchors odometry drifts, so that the level grows with the
// distance d since the last one:
//
//   PL(d) = PL_0 + k d
//
// d is uncertain before the flight: what is stated is the level that nine flights of ten stay below. With P_i of the
// looks behind, the last anchor lies within d with probability 1 - Π (1 - P_i); d is where this passes 0.9. Looks of
// neighbouring frames fail together (they see the same ground), so that only one look in kLookCorrelation_m counts as
// new evidence. PL_0, k and the correlation: navigability_parameters.hpp, fitted to simulated flights.
//
// A leg is a section of the route with one verdict: good where P is high, poor where it is low, fair between them, and
// beyond the alert limit where the level exceeds it. Poor legs and those beyond the limit carry the reason, and what
// was tried and helps: another height, a leg beside it, fresher or finer imagery.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/progress.hpp"
#include "imagery/terrain_raster.hpp"
#include "navigability/look_model.hpp"
#include "package/mission.hpp"
#include "package/sidecar.hpp"

namespace nadir {

struct PredictionOptions {
  CameraModel camera;
  std::optional<double> spacing_m;  // of the frames; default: neighbours overlap by 70 %
  double search_m = kMatchabilityRadius_m;
  UtcTime at;  // ages of the imagery
  int threads = 1;
};

enum class LegVerdict { good, fair, poor };
std::string_view name_of(LegVerdict verdict);

struct PredictedLook {
  double at_m = 0;  // along the route
  LonLat place;
  double agl_m = 0;
  double frame_width_m = 0, frame_height_m = 0;  // the footprint on the ground
  std::optional<int> imagery_age_days;
  ProbedGround features;
  double probability = 0;  // that the look anchors
  double since_anchor_m = 0;
  double hpl_m = 0;  // protection level that nine flights of ten stay below
};

struct PredictedLeg {
  LegVerdict verdict = LegVerdict::good;
  bool beyond_alert_limit = false;
  std::size_t first = 0, last = 0;  // of the looks
  double begin_m = 0, length_m = 0;
  double probability = 0;               // mean
  double hpl_m = 0;                     // largest
  std::string reason{};                 // of all but good ones within the limit
  std::vector<std::string> remedies{};  // what helps, by trial
};

struct RoutePrediction {
  std::vector<PredictedLook> looks;
  std::vector<PredictedLeg> legs;
  double spacing_m = 0;
  double route_m = 0;
  double alert_limit_m = 0;
  double good_m = 0, fair_m = 0, poor_m = 0, beyond_m = 0;  // of the route
  bool terrain_known = true;  // false: heights above ground are as if the ground were flat
};

// tiles: of the package, read from several threads. sidecars: in the order of TileKey, for ages. Throws UsageError for
// an area alone and for a route that meets the ground; Interrupted by way of progress. The result does not depend on
// the number of threads.
RoutePrediction predict_route(const Mission& mission, const TileSource& tiles, std::span<const Sidecar> sidecars,
                              const TerrainRaster* terrain, const PredictionOptions& options, Progress& progress);

// The parts that need no map, for tests and for the bench that fits them.
void predict_protection(std::vector<PredictedLook>& looks);
std::vector<PredictedLeg> legs_of(const std::vector<PredictedLook>& looks, double alert_limit_m, double route_m);

}  // namespace nadir
