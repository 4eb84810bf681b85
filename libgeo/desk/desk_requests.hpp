// What callers send to a desk: new flights, and pictures with their telemetry. What must be in it, and in one answer
// all that is wrong with it.
#pragma once

#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "desk/desk_service.hpp"
#include "flights/flight_store.hpp"
#include "http/json_body.hpp"
#include "http/message.hpp"

namespace nadir {

// POST /v1/flights: {"name", "camera": the text of camera.yaml, "package"?, "start"?: {"lat", "lon"}}.
std::variant<NewFlight, Problem> parse_new_flight(const ApiRequest& request);

// Those members of a larger body; what else it has is the caller's.
enum class CameraMember { required, optional };
NewFlight read_flight_members(BodyFields& body, CameraMember camera);

// POST /v1/flights/{id}/pictures, one picture or several:
//
//   Content-Type: image/…            the picture; its name and telemetry are the query:
//   ?name=0001.jpg&time_s=12.5&agl_m=… Content-Type: multipart/form-data  parts "picture" with the names of their
//   files, and a part "telemetry": a table
//                                      as telemetry.csv, or JSON {"rows": […]} with members named as its columns. Rows
//                                      of other pictures are ignored, so that the whole flight's can be sent each time
//
// A picture without a row has no time, and the store refuses it by name. The offers refer to the request's body.
std::variant<std::vector<PictureOffer>, Problem> parse_pictures(const ApiRequest& request, std::size_t most);

// The offers in the order of time, those without a time last; [i]: the index in `offers` of the i-th.
std::vector<std::size_t> order_of_time(const std::vector<PictureOffer>& offers);

}  // namespace nadir
