// Shows a service's status: once, or again and again until somebody interrupts.
#pragma once

#include <iosfwd>

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

}  // namespace nadir
