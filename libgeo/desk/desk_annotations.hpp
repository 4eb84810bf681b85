// The calls by which a person helps with a flight (schemas/desk.openapi.json): fixes, objects that are marked in
// pictures, and the footprint of a frame, by which a picture is laid on the map.
//
//   POST   …/fixes                     {"lat", "lon", "radius_m", "frame"?, "by"?}            the aircraft was there
//                                      {"lat", "lon", "frame", "pixel": {"x", "y"}, "sigma_m"?, "by"?}
//                                                                      this pixel of the frame's picture shows that
//                                                                      place
//   DELETE …/fixes/ID                  withdraws it
//   POST   …/objects                   {"frame", "pixel", "name"?, "by"?}
//   PATCH  …/objects/ID                {"name"}
//   POST   …/objects/ID/sightings      {"frame", "pixel"}
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "desk/desk_routes.hpp"
#include "desk/frame_geometry.hpp"
#include "desk/live_flight.hpp"
#include "http/message.hpp"

namespace nadir {

inline constexpr double kMaxFixRadius_m = 100'000;

// The answer to a call of one of these paths. Throws UsageError for what the store refuses.
ApiResponse annotation_call(const DeskRoute& route, const ApiRequest& request, LiveFlight& flight,
                            const FlightGround& ground);

// The engine takes a hint before the next frame that it processes. A person looks at an earlier one: its place is moved
// along the track since then, and its radius grows by what is not known of that way. Throws UsageError for a frame that
// has not been processed.
SearchHint carried_to_the_present(SearchHint hint, std::size_t frame, const FlightStore& store);

}  // namespace nadir
