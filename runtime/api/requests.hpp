// The bodies of POST: what they must hold, what is refused and why (all of it in one answer), and what follows.
#pragma once

#include <array>
#include <optional>
#include <variant>

#include "api/flight_view.hpp"
#include "geodesy/local_frame.hpp"
#include "geodesy/lon_lat.hpp"
#include "http/message.hpp"
#include "vision/ground_surface.hpp"

namespace nadir {

// An operator's prior for the search: the aircraft is within radius_m of this place. Never taken as truth.
struct Hint {
  LonLat place;
  double radius_m = 0;  // above 0, at most kMaxHintRadius_m
};

// The body of POST /v1/hint: {"lat": …, "lon": …, "radius_m": …}, degrees.
std::variant<Hint, Problem> parse_hint(const ApiRequest& request);

// What is to change about a recording that is played.
struct PlaybackRequest {
  std::optional<bool> playing{};
  std::optional<int> speed{};    // one of kPlaybackSpeeds
  std::optional<double> at_s{};  // since the recording's first record
};
inline constexpr std::array kPlaybackSpeeds{1, 2, 4, 8, 16};  // seconds of the recording in a second

// The body of POST /v1/playback: {"playing": true, "speed": 4, "at_s": 123.4}, at least one of them.
std::variant<PlaybackRequest, Problem> parse_playback(const ApiRequest& request, double length_s);

// The ground of the package in its plane. Null: flat ground around the aircraft.
struct GroundModel {
  const LocalFrame* frame = nullptr;
  const GroundSurface* surface = nullptr;
};

// POST /v1/object-location. view: the service's own estimate of the pose, for bodies that bring none.
ApiResponse answer_object_location(const ApiRequest& request, const FlightView& view, const GroundModel& ground);

}  // namespace nadir
