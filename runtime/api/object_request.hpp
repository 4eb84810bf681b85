// POST /v1/object-location: the body, what is refused and why, and the answer.
#pragma once

#include "api/flight_view.hpp"
#include "geodesy/local_frame.hpp"
#include "http/message.hpp"
#include "vision/ground_surface.hpp"

namespace nadir {

// The ground of the package in its plane. Null: flat ground around the aircraft.
struct GroundModel {
  const LocalFrame* frame = nullptr;
  const GroundSurface* surface = nullptr;
};

// view: where the service believes the aircraft to be, for bodies that bring no pose of their own.
ApiResponse answer_object_location(const ApiRequest& request, const FlightView& view, const GroundModel& ground);

}  // namespace nadir
