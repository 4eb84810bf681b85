// Flights over the synthetic landscape that float. One whose frames the localizer matches nowhere: all of it floats
// until it is placed as a whole. And one of two passes that cross where there is no map: the second one floats until it
// is placed by the ground that both show.
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

// The first pass flies east, from where the map is to where it is not; the second one flies north over its end, half a
// minute later. The picture between them is black.
inline constexpr int kFirstPass = 11, kSecondPass = 9, kSecondBegins = kFirstPass + 1;
std::vector<Moment> crossing_moments();
std::vector<Moment> passing_moments();  // the second pass is over another land
std::unique_ptr<FlightStore> crossing_flight(const std::filesystem::path& folder, const std::vector<Moment>& moments);
FlightEngineSetup crossing_setup();
FlightEngineSetup blind_crossing_setup();  // the localizer matches nowhere: the first pass floats as well

}  // namespace nadir::test
