// A FlightView as text for its readers: JSON documents (schemas/nadird.openapi.yaml), server-sent events, metrics.
//
// Degrees, metres, seconds. Numbers that are not finite become null, text is printable UTF-8.
#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

#include "api/flight_view.hpp"
#include "http/server.hpp"

namespace nadir {

// Schema State without track, events and alarms: what changes all the time. age_s: how old the view is; all ages and
// durations in it are as of now, so that nothing stands still when the flight's thread does.
nlohmann::json state_json(const FlightView& view, double age_s);

nlohmann::json event_json(const FlightEvent& event, const FlightView& view, double age_s);
nlohmann::json track_json(const FlightView& view);  // oldest first
nlohmann::json package_json(const PackageView& package);
nlohmann::json playback_json(const PlaybackView& playback);

// GET /v1/events: server-sent events. What a reader gets next depends on the current view and on its cursor alone;
// there is no queue. A slow reader skips states and, when the ring has moved on meanwhile, gets the number of events
// that it missed.
//
//   event: log     id: BOOT-NUMBER, data: an event       in order, each once; resumed with Last-Event-ID
//   event: missed  data: {"count": N}                    events that are gone
//   event: state   data: the state without track         the latest
struct StreamCursor {
  std::string boot_id{};
  std::uint64_t last_event = 0;
  std::uint64_t version = 0;
};

// From the header Last-Event-ID; anything malformed is a fresh start.
StreamCursor cursor_from(std::string_view last_event_id);

// The text that brings a reader from its cursor to the view; empty when it is there. Moves the cursor.
std::string stream_text(const FlightView& view, double age_s, StreamCursor& cursor);

// Prometheus' text format (version 0.0.4): every metric with HELP and TYPE, units in the names.
std::string metrics_text(const FlightView& view, double age_s, const ServerCounts& server);

}  // namespace nadir
