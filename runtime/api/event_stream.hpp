// GET /v1/events: server-sent events. What a reader gets next depends on the present view and on its cursor alone;
// there is no queue. A slow reader skips states and, when the ring has moved on meanwhile, is told how many events it
// missed.
//
//   event: log     id: BOOT-NUMBER, data: an event       in order, each once; resumed with Last-Event-ID
//   event: missed  data: {"count": N}                    events that are gone
//   event: state   data: the state without track         the latest
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "api/flight_view.hpp"

namespace nadir {

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

}  // namespace nadir
