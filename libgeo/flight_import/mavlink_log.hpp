// Telemetry logs of ground stations (.tlog): MAVLink frames as they arrived by radio, each after the time of its
// arrival (8 bytes, big-endian, microseconds since 1970 by the ground station's clock).
//
// Attitude and position carry the autopilot's time since boot, which is log time here. What carries none (range finder
// and terrain reports) is given the time of its arrival, less the shortest delay of those that have both. UTC comes
// from the autopilot's SYSTEM_TIME; without it from the ground station's clock, and the import says so.
//
// A radio link loses messages: attitude comes four to ten times a second at best, and with gaps. Logs that the
// autopilot itself wrote (.BIN, .ulg) are better. Of several autopilots in one log the first counts.
#pragma once

#include "flight_import/flight_log.hpp"
#include "flight_import/log_stream.hpp"

namespace nadir {

// Throws UsageError when this is no telemetry log.
FlightLog read_mavlink_log(LogStream& stream);

bool is_mavlink_log(LogStream& stream);  // by its first bytes

}  // namespace nadir
