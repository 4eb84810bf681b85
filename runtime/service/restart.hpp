// What a saved flight is still worth: the position that it held, with σ grown by the way that the aircraft may have
// flown since. For some seconds it is better carried on by the velocity that it had, and σ allows for a turn.
//
// Within one boot of the computer the age is exact, whatever was done to the time of day. After a reboot only UTC can
// tell, and a computer without a battery for its clock starts with an old one: then the age is at least the time since
// the boot, and a minute is added for what nobody saw.
#pragma once

#include <optional>
#include <string>

#include "service/clock.hpp"
#include "service/saved_flight.hpp"

namespace nadir {

inline constexpr double kMaxRestartAge_s = 1800;    // older: another flight
inline constexpr double kRebootAllowance_s = 60;    // of unseen time
inline constexpr double kMinRestartSpeed_m_s = 15;  // of any aircraft in flight, whatever was measured last
inline constexpr double kRestartTurn_m_s2 = 2.5;    // one sigma of what it may have done meanwhile
inline constexpr double kRestartVelocitySigma_m_s = 1;
inline constexpr double kFirstPicture_s = 0.5;  // from the restart to the first picture, or before it

struct RestartPosition {
  LonLat place;
  double sigma_m = 0;    // one axis, grown; beyond kNoFixSigma_m it is a prior for the search and no fix
  double speed_m_s = 0;  // by which it grows on
  double age_s = 0;
  int segment = 0;
};

struct Restart {
  std::optional<RestartPosition> position;
  std::optional<SavedHint> hint;  // a prior as long as it is of this flight
  std::string reason;             // for the recorder: what was taken over, or why nothing
};

Restart restart_from(const SavedFlightReading& reading, const FlightClock& clock);

}  // namespace nadir
