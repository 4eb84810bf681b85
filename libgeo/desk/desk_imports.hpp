// The calls by which photos become a flight (schemas/desk.openapi.json, photo_imports.hpp):
//
//   POST   /v1/imports                 begins one
//   POST   /v1/imports/ID/files        multipart/form-data: parts "photo" with their names, and "log" of an autopilot
//   POST   /v1/imports/ID/flight       {"name", "package"?, "start"?, and what the photos do not say}: the flight, or
//                                      422 "import" with what is missing, by member of this body
//   DELETE /v1/imports/ID
#pragma once

#include "desk/desk_routes.hpp"
#include "desk/desk_service.hpp"
#include "http/message.hpp"

namespace nadir {

// The answer to a call of one of these paths. Throws UsageError and OutOfSpace.
ApiResponse import_call(const DeskRoute& route, const ApiRequest& request, DeskService& desk);

}  // namespace nadir
