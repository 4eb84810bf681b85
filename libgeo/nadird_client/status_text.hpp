// A WatchedStatus as text: a screen of lines, and one line.
#pragma once

#include <string>
#include <vector>

#include "nadird_client/watched_status.hpp"

namespace nadir {

// colour: with escape sequences for a terminal. most_events: of the last ones.
std::vector<std::string> status_screen(const WatchedStatus& status, bool colour, std::size_t most_events = 12);

// "normal, sigma 2.8 m, anchor 1.3 s ago, 3.0 frames/s (10 dropped), …"
std::string status_line(const WatchedStatus& status);

std::string event_line(const WatchedEvent& event);

// "45 s", "12 min", "3.4 h"
std::string short_duration(double seconds);

}  // namespace nadir
