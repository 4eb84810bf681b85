#include "service/restart.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "geodesy/local_frame.hpp"

namespace nadir {
namespace {

struct Age {
  double s = 0;
  bool same_boot = false;
};

Age age_of(const SavedFlight& flight, double monotonic_s, std::int64_t unix_us, const FlightClock& clock) {
  const double now_s = clock.monotonic_s();
  if (!flight.boot_id.empty() && flight.boot_id == clock.boot_id()) return {now_s - monotonic_s, true};
  const double by_utc_s = 1e-6 * static_cast<double>(clock.unix_us() - unix_us);
  if (by_utc_s < 0) return {by_utc_s, false};
  return {std::max(by_utc_s, now_s) + kRebootAllowance_s, false};
}

// Carried on by its velocity, with what that is off by.
RestartPosition carried(const SavedEstimate& estimate, const SavedVelocity& velocity, double age_s) {
  const double turn_m = 0.5 * kRestartTurn_m_s2 * age_s * age_s;
  const double waiting_m = kFirstPicture_s * std::hypot(velocity.east_m_s, velocity.north_m_s);
  return {.place = LocalFrame(estimate.place).lonlat_from_enu(velocity.east_m_s * age_s, velocity.north_m_s * age_s),
          .sigma_m = estimate.sigma_m + std::hypot(turn_m, kRestartVelocitySigma_m_s * age_s, waiting_m)};
}

}  // namespace

Restart restart_from(const SavedFlightReading& reading, const FlightClock& clock) {
  if (!reading.flight) return {{}, {}, reading.refusal};
  const SavedFlight& flight = *reading.flight;

  const Age saved = age_of(flight, flight.saved_monotonic_s, flight.saved_unix_us, clock);
  if (saved.s < 0) return {{}, {}, fmt::format("saved {:.0f} s from now, in the future", -saved.s)};
  if (saved.s > kMaxRestartAge_s) return {{}, {}, fmt::format("saved {:.0f} s ago: another flight", saved.s)};

  Restart restart{{}, flight.hint, {}};
  if (!flight.estimate || flight.estimate->source == SourceLabel::no_fix) {
    restart.reason = fmt::format("saved {:.1f} s ago without a position", saved.s);
    return restart;
  }
  const SavedEstimate& estimate = *flight.estimate;
  const Age age = age_of(flight, estimate.monotonic_s, estimate.unix_us, clock);
  if (age.s < saved.s) {
    restart.reason = "the saved position is younger than its file";
    return restart;
  }
  const double speed_m_s = std::max(estimate.ground_speed_m_s, kMinRestartSpeed_m_s);
  RestartPosition position{.place = estimate.place, .sigma_m = estimate.sigma_m + age.s * speed_m_s};
  if (estimate.velocity) {
    const RestartPosition flown_on = carried(estimate, *estimate.velocity, age.s);
    if (flown_on.sigma_m < position.sigma_m) position = flown_on;
  }
  position.speed_m_s = speed_m_s;
  position.age_s = age.s;
  position.segment = estimate.segment;
  restart.position = position;
  restart.reason = fmt::format("position of {:.1f} s ago{}, σ {:.0f} m grown to {:.0f} m", age.s,
                               age.same_boot ? "" : ", over a reboot", estimate.sigma_m, position.sigma_m);
  return restart;
}

}  // namespace nadir
