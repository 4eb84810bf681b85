// Telemetry as the localizer may believe it: what cannot be is unknown. An autopilot's NaN must not reach the beliefs,
// which would never get rid of it.
#pragma once

#include "estimation/telemetry.hpp"

namespace nadir {

// A time that is no number becomes last_time_s.
Telemetry plausible_telemetry(Telemetry telemetry, double last_time_s);

}  // namespace nadir
