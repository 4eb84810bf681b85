// The states of a flight, the reasons of transitions, and the texts for the operator.
//
//   boot ── no_package
//     │
//   awaiting_autopilot
//     │
//   relocalizing ──► normal ◄──► degraded ──► no_fix ──► normal
//
//   any of them ──► failsafe ──► normal, or back to where GPS, trusted again, allows
//
// docs/onboard.md lists every reason; a test compares the page with service_state.cpp.
#pragma once

#include <span>
#include <string_view>

namespace nadir {

enum class ServiceState {
  boot,                // the package is being verified
  no_package,          // rejected: the service runs and reports why, without a position
  awaiting_autopilot,  // the package is accepted; no authenticated autopilot yet
  relocalizing,        // searches for the first map match
  normal,              // satellite_anchored or vo_extrapolated
  degraded,            // dead_reckoned
  no_fix,              // the position is not accurate enough to be sent
  failsafe,            // and no trusted GPS either
};

std::string_view name_of(ServiceState state);

enum class ServiceReason {
  started,
  package_verified,
  package_refused,
  link_authentic,
  link_without_signing,
  first_anchor,
  restored,
  frame_unfit,
  camera_silent,
  localizer_late,
  matcher_failing,
  vision_back,
  blind_too_long,
  sigma_too_large,
  localizer_lost,
  integrity_lost,
  anchored_again,
  no_position,
  gps_position,
  // Notices that change no state:
  link_unsigned,
  link_lost,
  link_back,
  gps_denied,
  gps_spoofed,
  gps_trusted,
  vision_leads,
  vision_leads_unconfirmed,
  gps_leads,
  position_not_usable,
  position_usable_again,
};

// The values of MAVLink's MAV_SEVERITY.
enum class OperatorSeverity { emergency, alert, critical, error, warning, notice, info };

struct ReasonText {
  ServiceReason reason;
  std::string_view name;         // stable: in the recorder, in the API, in scripts
  std::string_view explanation;  // for the recorder and docs/onboard.md
  OperatorSeverity severity;
  std::string_view operator_text;  // empty: not sent. At most 50 characters: one STATUSTEXT
};

std::span<const ReasonText> all_reasons();
const ReasonText& text_of(ServiceReason reason);

}  // namespace nadir
