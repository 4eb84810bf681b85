// FlightViews as JSON documents (schemas/nadird.openapi.yaml): degrees, metres, seconds. Numbers that are no finite
// numbers become null, text is printable UTF-8.
#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

#include "api/flight_view.hpp"

namespace nadir {

// Schema State without track and events: what changes all the time. age_s: how old the view is.
nlohmann::json state_json(const FlightView& view, double age_s);

nlohmann::json event_json(const FlightEvent& event, const FlightView& view);
nlohmann::json track_json(const FlightView& view);  // oldest first
nlohmann::json package_json(const PackageView& package);

// GET /v1/events: server-sent events. What a reader gets next depends on the present view and on its cursor alone;
// there is no queue. A slow reader skips states and, when the ring has moved on meanwhile, is told how many events it
// missed.
//
//   event: log     id: BOOT-NUMBER, data: an event       in order, each once; resumed with Last-Event-ID
//   event: missed  data: {"count": N}                    events that are gone
//   event: state   data: the state without track         the latest

struct StreamCursor {
  std::string boot_id{};
  std::uint64_t last_event = 0;
  std::uint64_t version = 0;
};

// From the header Last-Event-ID; whatever does not read is a fresh start.
StreamCursor cursor_from(std::string_view last_event_id);

// The text that brings a reader from its cursor to the view; empty when it is there. Moves the cursor.
std::string stream_text(const FlightView& view, double age_s, StreamCursor& cursor);

inline constexpr std::string_view kStreamHello = "retry: 2000\n\n";
inline constexpr std::string_view kStreamHeartbeat = ": alive\n\n";

// A FlightView as Prometheus' text format (version 0.0.4): every metric with HELP and TYPE, units in the names.

// What the server knows about itself.
struct ServerCounts {
  std::uint64_t connections_open = 0, connections_total = 0, connections_refused = 0;
  std::uint64_t requests_total = 0;
  std::uint64_t streams_open = 0, streams_refused = 0, streams_dropped = 0;  // dropped: too slow, or dead
};

std::string metrics_text(const FlightView& view, double age_s, const ServerCounts& server);

}  // namespace nadir
