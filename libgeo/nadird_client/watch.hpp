// Shows the status of a running nadird: once, or repeatedly until interrupted.
#pragma once

#include <iosfwd>

#include "nadird_client/nadird_client.hpp"

namespace nadir {

enum class WatchForm {
  screen,  // a terminal screen, redrawn each time
  lines,   // one per poll and one per event
  json,    // one document per line
};

// Exit code: 0, or 1 when there is no position, the flight thread is stalled, or it is a recording that is played.
// `nadird --status` is this.
int show_once(const NadirdClient& service, std::ostream& out, bool as_json);

// Throws Error when the first poll fails; later failures are shown and retried. Ends on Ctrl-C.
void keep_showing(const NadirdClient& service, std::ostream& out, WatchForm form, double interval_s);

}  // namespace nadir
