// Flights over the synthetic landscape as pictures, for tests of stored flights.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "estimation/localizer_fixture.hpp"
#include "flights/flight_engine.hpp"
#include "flights/flight_store.hpp"

namespace nadir::test {

inline constexpr UtcMillis kNow{1'750'000'000'000};

// A picture with its bytes; offer() refers to them.
struct EncodedPicture {
  std::string name;
  Telemetry telemetry;
  Bytes bytes;

  PictureOffer offer() const { return {.name = name, .telemetry = telemetry, .bytes = bytes, .folder = nullptr}; }
};

std::vector<PictureOffer> offers(const std::vector<EncodedPicture>& pictures);

// Small and all different; picture i was taken at i seconds and has the size of flight_camera().
EncodedPicture plain_picture(int number);

enum class Course {
  smooth,   // every frame is tracked and anchored
  rolling,  // the same by a camera with a rolling shutter, which has to be undone
  eventful  // a black frame, a repeated one and one of another place; the start is not known
};
const std::vector<EncodedPicture>& flight_pictures(Course course);  // made once
FlightDescription description(Course course);
FlightEngineSetup engine_setup(Course course);

// A new flight with these pictures.
std::unique_ptr<FlightStore> stored_flight(const std::filesystem::path& folder, Course course,
                                           const FlightStoreOptions& options = {});

// All that a flight has become, as text: estimates in every bit but their latency, segments, events but their times.
std::string written_out(const FlightStore& store);

}  // namespace nadir::test
