// What a restart in flight needs to know, as text: one line of JSON ("nadir.flight/1") and, in a second line, its
// SHA-256. Whatever is not exactly that is refused with a reason and passes for nothing: a position from a damaged file
// would be a lie.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "estimation/source_label.hpp"
#include "geodesy/lon_lat.hpp"
#include "service/service_state.hpp"

namespace nadir {

struct SavedVelocity {
  double east_m_s = 0;
  double north_m_s = 0;
};

struct SavedEstimate {
  double monotonic_s = 0;  // when it was true
  std::int64_t unix_us = 0;
  LonLat place;
  double sigma_m = 0;  // one axis
  double ground_speed_m_s = 0;
  SourceLabel source = SourceLabel::no_fix;
  int segment = 0;
  std::optional<SavedVelocity> velocity{};  // none: only its amount is known
};

struct SavedHint {
  LonLat place;
  double radius_m = 0;
};

struct SavedFlight {
  std::string boot_id;  // of which boot the monotonic times count
  double saved_monotonic_s = 0;
  std::int64_t saved_unix_us = 0;
  ServiceState state = ServiceState::boot;
  std::optional<SavedEstimate> estimate;
  std::optional<SavedHint> hint;  // the operator's, or where the flight began
};

// Throws Error for numbers that are none (NaN, beyond their range): nothing that cannot be read again is written.
std::string to_text(const SavedFlight& flight);

struct SavedFlightReading {
  std::optional<SavedFlight> flight;
  std::string refusal;  // empty exactly when there is a flight
};
SavedFlightReading parse_saved_flight(std::string_view text);

}  // namespace nadir
