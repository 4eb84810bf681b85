#include "api/event_stream.hpp"

#include <fmt/format.h>

#include <charconv>
#include <iterator>
#include <nlohmann/json.hpp>

#include "api/state_json.hpp"

namespace nadir {
namespace {

// Ids go into a line of their own: letters and digits alone.
std::string plain(std::string_view text) {
  std::string kept;
  for (const char c : text) {
    if ((c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z')) kept += c;
  }
  return kept;
}

}  // namespace

StreamCursor cursor_from(std::string_view last_event_id) {
  const std::size_t dash = last_event_id.rfind('-');
  if (dash == std::string_view::npos) return {};
  const std::string_view digits = last_event_id.substr(dash + 1);
  StreamCursor cursor;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), cursor.last_event);
  if (error != std::errc{} || end != digits.data() + digits.size()) return {};
  cursor.boot_id = last_event_id.substr(0, dash);
  return cursor;
}

std::string stream_text(const FlightView& view, double age_s, StreamCursor& cursor) {
  const std::string boot = plain(view.boot_id);
  if (cursor.boot_id != boot) cursor = {.boot_id = boot};
  // A cursor ahead of every event is none of ours.
  if (!view.events.empty() && cursor.last_event > view.events.back().id) cursor.last_event = 0;

  std::string text;
  const auto out = std::back_inserter(text);
  if (!view.events.empty() && cursor.last_event != 0 && view.events.front().id > cursor.last_event + 1) {
    fmt::format_to(out, "event: missed\ndata: {{\"count\":{}}}\n\n", view.events.front().id - cursor.last_event - 1);
  }
  for (const FlightEvent& event : view.events) {
    if (event.id <= cursor.last_event) continue;
    fmt::format_to(out, "id: {}-{}\nevent: log\ndata: {}\n\n", boot, event.id, event_json(event, view).dump());
    cursor.last_event = event.id;
  }
  if (cursor.version != view.version) {
    fmt::format_to(out, "event: state\ndata: {}\n\n", state_json(view, age_s).dump());
    cursor.version = view.version;
  }
  return text;
}

}  // namespace nadir
