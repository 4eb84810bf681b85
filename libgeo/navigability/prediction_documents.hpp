// A prediction as documents: for programs, for maps, and as figures for people.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "navigability/route_prediction.hpp"

namespace nadir {

// {"schema": "nadir.prediction/1", route_m, spacing_m, alert_limit_m, start_m, good_m, fair_m, poor_m, beyond_m,
// terrain_known,
//  legs: [{verdict, beyond_alert_limit, begin_m, length_m, from, to, probability, hpl_m, reason, remedies}],
//  looks: [{at_m, lon_deg, lat_deg, agl_m, probability, since_anchor_m, hpl_m, beyond_share, map_sigma_m,
//  imagery_age_days, …features}]}. hpl_m: null where too many flights have none
nlohmann::json prediction_json(const RoutePrediction& prediction);

// RFC 7946: each leg as a line, each look as a point with its frame's size; with the attributes of the above.
nlohmann::json prediction_geojson(const RoutePrediction& prediction);

}  // namespace nadir
