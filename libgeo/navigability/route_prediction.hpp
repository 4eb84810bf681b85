// Where along the route would the aircraft know its position? Predicted from the package, the camera and the heights.
//
// At every frame of the planned flight: the probability that the map there can be matched (look_model.hpp), the share
// of flights that anchor there, and the protection level that the integrity monitor would state. The flight is drawn
// many times, look by look, with the belief that flies (protection_forecast.hpp): a flight that was lost over a lake
// anchors over no ground behind it, however good. Stated is the level that nine flights of ten stay below.
//
// The start: a position that a person gave is wrong more often than the integrity risk. Until looks at different ground
// have agreed the level is beyond any limit, on every route, for a few footprints. This is stated as start_m and is no
// leg; a start that takes longer is one, with its reason.
//
// A leg is a section of the route with one verdict: good where nearly all flights anchor, poor where few do, fair
// between them, and beyond the alert limit where the level exceeds it. Poor legs and those beyond the limit carry the
// reason, and what was tried and helps: another height, a leg beside it, fresher or finer imagery.
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
  TelemetryUncertainty uncertainty;  // of the camera file
  std::optional<double> spacing_m;   // of the predicted looks; default: that of the frames, at most 70 % overlap
  std::optional<double> speed_mps;   // ground speed; default: that of a small fixed wing
  std::optional<double> interval_s;  // between the flown frames; default: neighbours overlap by 70 %
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
  double probability = 0;         // that the look anchors, asked of the map alone
  double anchored_share = 0;      // of the flights: this look anchors
  double map_sigma_m = 0;         // one axis of the map's own error here
  double since_anchor_m = 0;      // at most, in nine flights of ten
  std::optional<double> hpl_m{};  // protection level that nine flights of ten stay below; nothing: too many have none
  double beyond_share = 0;        // of the flights: beyond the alert limit, or without a level
};

struct PredictedLeg {
  LegVerdict verdict = LegVerdict::good;
  bool beyond_alert_limit = false;
  std::size_t first = 0, last = 0;  // of the looks
  double begin_m = 0, length_m = 0;
  double probability = 0;               // mean, of the map alone
  double anchored_share = 0;            // mean; before the start is confirmed, that of the map alone
  std::optional<double> hpl_m{};        // largest; nothing: one look has none
  std::string reason{};                 // of all but good ones within the limit
  std::vector<std::string> remedies{};  // what helps, by trial
};

struct RoutePrediction {
  std::vector<PredictedLook> looks;
  std::vector<PredictedLeg> legs;
  double spacing_m = 0;
  double route_m = 0;
  double alert_limit_m = 0;
  double start_m = 0;                                       // of the route, until the start is confirmed
  double good_m = 0, fair_m = 0, poor_m = 0, beyond_m = 0;  // of the route
  bool terrain_known = true;  // false: heights above ground are as if the ground were flat
};

// tiles: of the package, read from several threads. sidecars: in the order of TileKey, for ages. Throws UsageError for
// an area alone and for a route that meets the ground; Interrupted by way of progress. The result does not depend on
// the number of threads.
RoutePrediction predict_route(const Mission& mission, const TileSource& tiles, std::span<const Sidecar> sidecars,
                              const TerrainRaster* terrain, const PredictionOptions& options, Progress& progress);

// The part that needs no map, for tests. Up to start_m a look's verdict is that of the map alone: it anchors late, on
// every route, and is no reason for a leg to be beyond the limit.
std::vector<PredictedLeg> legs_of(const std::vector<PredictedLook>& looks, double alert_limit_m, double route_m,
                                  double start_m = 0);

}  // namespace nadir
