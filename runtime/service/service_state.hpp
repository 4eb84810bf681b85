// The states of a flight, why one follows another, and what the operator is told.
//
//   boot ── no_package
//     │
//   awaiting_autopilot
//     │
//   relocalizing ──► normal ◄──► degraded ──► no_fix ──► normal
//
//   any of them ──► failsafe ──► normal, or back where a GPS that is trusted again leaves it
//
// docs/onboard.md lists every reason; a test holds the page against this file.
#pragma once

#include <span>
#include <string_view>

namespace nadir {

enum class ServiceState {
  boot,                // the package is being verified
  no_package,          // it was refused: serves, says why, tells no position
  awaiting_autopilot,  // the package is good; nobody trustworthy to tell
  relocalizing,        // looks for the first place on the map
  normal,              // satellite_anchored or vo_extrapolated
  degraded,            // dead_reckoned
  no_fix,              // not known well enough to be said
  failsafe,            // and neither does GPS know
};

std::string_view name_of(ServiceState state);

enum class ServiceReason {
  started,
  package_verified,
  package_refused,
  link_authentic,
  first_anchor,
  restored,
  frame_unfit,
  camera_silent,
  localizer_late,
  vision_back,
  blind_too_long,
  sigma_too_large,
  localizer_lost,
  anchored_again,
  no_position,
  gps_position,
  // The state stays what it is:
  link_unsigned,
  link_lost,
  link_back,
  gps_denied,
  gps_spoofed,
  gps_trusted,
  vision_leads,
  gps_leads,
};

// MAVLink's numbers.
enum class OperatorSeverity { emergency, alert, critical, error, warning, notice, info };

struct ReasonText {
  ServiceReason reason;
  std::string_view name;         // stable: in the recorder, in the API, in scripts
  std::string_view explanation;  // for the recorder and docs/onboard.md
  OperatorSeverity severity;
  std::string_view operator_text;  // empty: the operator need not know. At most 50 characters: one STATUSTEXT
};

std::span<const ReasonText> all_reasons();
const ReasonText& text_of(ServiceReason reason);

}  // namespace nadir
