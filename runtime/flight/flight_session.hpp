// What the recorder writes first: who flies, and all that the localizer starts from, so that `nadir replay --recorder`
// starts from the same.
#pragma once

#include "flight/flight_ground.hpp"
#include "flight/localizing.hpp"
#include "recorder/records.hpp"
#include "service/clock.hpp"
#include "vision/camera.hpp"

namespace nadir {

SessionRecord flight_session(const Airframe& airframe, const FlightClock& clock);

// Throws Error when the package's manifest cannot be read any more.
void add_start(SessionRecord& session, const LocalizingSetup& setup, const FlightGround& ground);

}  // namespace nadir
