// Shows a service's status: once, or again and again until somebody interrupts.
#pragma once

#include <iosfwd>
#include <string>
#include <vector>

#include "nadird_client/nadird_client.hpp"

namespace nadir {

enum class WatchForm {
  screen,  // a terminal's, drawn anew each time
  lines,   // one for each look and one for each event
  json,    // a document a line
};

// Exit code: 0, or 1 when there is no position or the flight's thread is silent. `nadird --status` is this.
int show_once(const NadirdClient& service, std::ostream& out, bool as_json);

// Throws Error when the first look fails; later ones that fail are said and tried again. Ends on Ctrl-C.
void keep_showing(const NadirdClient& service, std::ostream& out, WatchForm form, double interval_s);

// A WatchedStatus as text: a screen of lines, and one line.

// colour: with escape sequences for a terminal. most_events: of the last ones.
std::vector<std::string> status_screen(const WatchedStatus& status, bool colour, std::size_t most_events = 12);

// "normal, sigma 2.8 m, anchor 1.3 s ago, 3.0 frames/s (10 dropped), …"
std::string status_line(const WatchedStatus& status);

std::string event_line(const WatchedEvent& event);

// "45 s", "12 min", "3.4 h"
std::string short_duration(double seconds);

}  // namespace nadir
