// The calls of a desk that are about missions: /v1/planning, /v1/imagery, /v1/missions (schemas/desk.openapi.json).
#pragma once

#include "desk/desk_routes.hpp"
#include "desk/desk_service.hpp"
#include "http/message.hpp"

namespace nadir {

bool is_mission_path(DeskPath path);

// Throws as PlanningRoom.
ApiResponse mission_call(const DeskRoute& route, const ApiRequest& request, DeskService& desk);

}  // namespace nadir
