// A flight over the synthetic landscape whose frames the localizer matches nowhere: all of it floats until it is placed
// as a whole.
#pragma once

#include "flights/stored_flight.hpp"

namespace nadir::test {

inline constexpr int kFloatingFrames = 9;

std::vector<Moment> floating_moments();
// A new flight with its first pictures.
std::unique_ptr<FlightStore> floating_flight(const std::filesystem::path& folder, int frames = kFloatingFrames,
                                             const FlightStoreOptions& options = {});
void add_floating_pictures(FlightStore& store, int first, int end);
// One engine each: its localizer is given a matcher that finds nothing, its placer the real one.
FlightEngineSetup floating_setup();
FlightEngineSetup elsewhere_setup();  // … and the placer one that sees mirrored pictures

}  // namespace nadir::test
