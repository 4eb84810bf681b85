// A FlightView as Prometheus' text format (version 0.0.4): every metric with HELP and TYPE, units in the names.
#pragma once

#include <string>

#include "api/flight_view.hpp"

namespace nadir {

// What the server knows about itself.
struct ServerCounts {
  std::uint64_t connections_open = 0, connections_total = 0, connections_refused = 0;
  std::uint64_t requests_total = 0;
  std::uint64_t streams_open = 0, streams_refused = 0, streams_dropped = 0;  // dropped: too slow, or dead
};

std::string metrics_text(const FlightView& view, double age_s, const ServerCounts& server);

}  // namespace nadir
