// FlightViews as JSON documents (schemas/nadird.openapi.yaml): degrees, metres, seconds. Numbers that are no finite
// numbers become null, text is printable UTF-8.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "api/flight_view.hpp"

namespace nadir {

// Schema State without track and events: what changes all the time. age_s: how old the view is.
nlohmann::json state_json(const FlightView& view, double age_s);

nlohmann::json event_json(const FlightEvent& event, const FlightView& view);
nlohmann::json track_json(const FlightView& view);  // oldest first
nlohmann::json package_json(const PackageView& package);

}  // namespace nadir
