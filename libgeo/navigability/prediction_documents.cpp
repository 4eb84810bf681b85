#include "navigability/prediction_documents.hpp"

#include <cmath>
#include <nlohmann/json.hpp>

namespace nadir {
namespace {

using nlohmann::json;

double rounded_to(double value, double steps) { return std::round(value * steps) / steps; }
json metres(const std::optional<double>& value) { return value ? json(rounded_to(*value, 10)) : json(); }
json position(LonLat place) { return {rounded_to(place.lon_deg, 1e7), rounded_to(place.lat_deg, 1e7)}; }

json facts_of(const PredictedLook& look) {
  return {{"at_m", rounded_to(look.at_m, 10)},
          {"agl_m", rounded_to(look.agl_m, 10)},
          {"frame_width_m", rounded_to(look.frame_width_m, 10)},
          {"frame_height_m", rounded_to(look.frame_height_m, 10)},
          {"probability", rounded_to(look.probability, 1e4)},
          {"anchored_share", rounded_to(look.anchored_share, 1e3)},
          {"since_anchor_m", rounded_to(look.since_anchor_m, 10)},
          {"hpl_m", metres(look.hpl_m)},
          {"beyond_share", rounded_to(look.beyond_share, 1e3)},
          {"map_sigma_m", rounded_to(look.map_sigma_m, 100)},
          {"imagery_age_days", look.imagery_age_days ? json(*look.imagery_age_days) : json()},
          {"footprint_m", rounded_to(look.features.footprint_m, 10)},
          {"map_gsd_m", rounded_to(look.features.map_gsd_m, 1e4)},
          {"match_gsd_m", rounded_to(look.features.gsd_m, 1e4)},
          {"valid", rounded_to(look.features.valid, 1e4)},
          {"ratio", rounded_to(look.features.ratio, 1e4)},
          {"log_score", rounded_to(look.features.log_score, 1e4)},
          {"texture", rounded_to(look.features.texture, 1e3)}};
}

json facts_of(const PredictedLeg& leg) {
  return {{"verdict", name_of(leg.verdict)},
          {"beyond_alert_limit", leg.beyond_alert_limit},
          {"begin_m", rounded_to(leg.begin_m, 10)},
          {"length_m", rounded_to(leg.length_m, 10)},
          {"probability", rounded_to(leg.probability, 1e4)},
          {"anchored_share", rounded_to(leg.anchored_share, 1e4)},
          {"hpl_m", metres(leg.hpl_m)},
          {"reason", leg.reason},
          {"remedies", leg.remedies}};
}

}  // namespace

json prediction_json(const RoutePrediction& prediction) {
  json legs = json::array(), looks = json::array();
  for (const PredictedLeg& leg : prediction.legs) {
    json item = facts_of(leg);
    item["from"] = position(prediction.looks[leg.first].place);
    item["to"] = position(prediction.looks[leg.last].place);
    legs.push_back(std::move(item));
  }
  for (const PredictedLook& look : prediction.looks) {
    json item = facts_of(look);
    item["lon_deg"] = rounded_to(look.place.lon_deg, 1e7);
    item["lat_deg"] = rounded_to(look.place.lat_deg, 1e7);
    looks.push_back(std::move(item));
  }
  return {{"schema", "nadir.prediction/1"},
          {"route_m", rounded_to(prediction.route_m, 10)},
          {"spacing_m", rounded_to(prediction.spacing_m, 10)},
          {"alert_limit_m", prediction.alert_limit_m},
          {"start_m", rounded_to(prediction.start_m, 10)},
          {"good_m", rounded_to(prediction.good_m, 10)},
          {"fair_m", rounded_to(prediction.fair_m, 10)},
          {"poor_m", rounded_to(prediction.poor_m, 10)},
          {"beyond_m", rounded_to(prediction.beyond_m, 10)},
          {"terrain_known", prediction.terrain_known},
          {"legs", legs},
          {"looks", looks}};
}

json prediction_geojson(const RoutePrediction& prediction) {
  json features = json::array();
  for (const PredictedLeg& leg : prediction.legs) {
    json line = json::array();
    for (std::size_t i = leg.first; i <= std::min(leg.last + 1, prediction.looks.size() - 1); ++i) {
      line.push_back(position(prediction.looks[i].place));
    }
    if (line.size() < 2) line.push_back(line.front());
    json properties = facts_of(leg);
    properties["kind"] = "leg";
    features.push_back({{"type", "Feature"},
                        {"geometry", {{"type", "LineString"}, {"coordinates", line}}},
                        {"properties", properties}});
  }
  for (const PredictedLook& look : prediction.looks) {
    json properties = facts_of(look);
    properties["kind"] = "look";
    features.push_back({{"type", "Feature"},
                        {"geometry", {{"type", "Point"}, {"coordinates", position(look.place)}}},
                        {"properties", properties}});
  }
  return {{"type", "FeatureCollection"}, {"features", features}};
}

}  // namespace nadir
