// What survives a restart in flight: the saved flight, the state directory that contains it, and the prior that a
// restart derives from it.
//
// flight.json is one line of JSON ("nadir.flight/1") and, in a second line, its SHA-256. A file that is not exactly
// that is rejected with a reason: a position from a damaged file would be wrong.
//
// After a restart the position is propagated with its velocity v for its age t, and σ grows with an unobserved turn
// (kRestartTurn_mps2), the error of v, and the distance until the first frame. Where σ + v t with the position as it
// was is smaller, that is used instead:
//   σ₁ = σ₀ + hypot(a t²/2, σ_v t, v t_f)        σ₂ = σ₀ + max(v, v_min) t
//
// Within one boot of the computer the age is exact, whatever was done to the system clock. After a reboot only UTC
// counts, and a computer without a battery-backed clock starts with an old one: then the age is at least the time since
// boot, plus a minute for the unobserved time. Where the flight is known to be the same one (acceptance_record.hpp) and
// UTC makes no sense, the age is just that.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "estimation/source_label.hpp"
#include "geodesy/lon_lat.hpp"
#include "service/acceptance_record.hpp"
#include "service/clock.hpp"
#include "service/service_state.hpp"

namespace nadir {

struct SavedVelocity {
  double east_mps = 0;
  double north_mps = 0;
};

struct SavedEstimate {
  double monotonic_s = 0;  // when it was valid
  std::int64_t unix_us = 0;
  LonLat place;
  double sigma_m = 0;  // one axis
  double ground_speed_mps = 0;
  SourceLabel source = SourceLabel::no_fix;
  int segment = 0;
  std::optional<SavedVelocity> velocity{};  // nullopt: only the speed is known
};

struct SavedHint {
  LonLat place;
  double radius_m = 0;
};

struct SavedFlight {
  std::string boot_id;  // of the monotonic times
  double saved_monotonic_s = 0;
  std::int64_t saved_unix_us = 0;
  ServiceState state = ServiceState::boot;
  std::optional<SavedEstimate> estimate;
  std::optional<SavedHint> hint;  // the operator's, or the start position
};

// Throws Error for NaN and values out of range: a file that could not be read again is never written.
std::string to_text(const SavedFlight& flight);

struct SavedFlightReading {
  std::optional<SavedFlight> flight;
  std::string rejection;  // empty if and only if there is a flight
};
SavedFlightReading parse_saved_flight(std::string_view text);

// The folder from which a restart continues a flight: flight.json, replaced atomically about once a second. Other parts
// keep their own files beside it (the signing time of the link, the aircraft's memory of packages).
//
// Writing syncs to disk and may be slow: it belongs to the upkeep thread, never to the path of a frame. A full disk
// costs the restart its memory, not the flight.
class StateDirectory {
 public:
  explicit StateDirectory(std::filesystem::path folder) : folder_(std::move(folder)) {}

  // Creates the folder if it is missing and removes temporary files of a killed writer. Throws Error when nothing can
  // be written there; what is there can still be loaded.
  void prepare() const;

  const std::filesystem::path& folder() const { return folder_; }

  // The error, or nullopt. After an error the file is still the last one.
  std::optional<std::string> save(const SavedFlight& flight) const;

  // A missing, damaged or unreadable file is rejected with the reason.
  SavedFlightReading load() const;

  // The same for what was accepted. Throws Error when it cannot be written.
  void save(const AcceptanceRecord& record) const;
  AcceptanceReading load_acceptance() const;

 private:
  std::filesystem::path file() const { return folder_ / "flight.json"; }

  std::filesystem::path folder_;
};

struct RestartPosition {
  LonLat place;
  double sigma_m = 0;    // one axis, with its growth; beyond kNoFixSigma_m a prior for the search, not a fix
  double speed_mps = 0;  // by which σ keeps growing
  double age_s = 0;
  int segment = 0;
};

struct Restart {
  std::optional<RestartPosition> position;
  std::optional<SavedHint> hint;  // a prior, while it is of this flight
  std::string reason;             // for the recorder: what was restored, or why nothing
};

// same_flight: the aircraft has not landed since the flight was saved.
Restart restart_from(const SavedFlightReading& reading, const FlightClock& clock, bool same_flight = false);

}  // namespace nadir
