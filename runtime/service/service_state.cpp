#include "service/service_state.hpp"

#include <array>
#include <cstddef>

namespace nadir {
namespace {

using enum ServiceReason;
using enum OperatorSeverity;

// In the order of the enumeration, so that a reason is its own index.
constexpr std::array kReasons{
    ReasonText{started, "started", "the service has started", info, ""},
    ReasonText{package_verified, "package_verified", "the package is signed and complete", info, ""},
    ReasonText{package_refused, "package_refused", "the package failed verification", critical,
               "Nadir: map package rejected, no position"},
    ReasonText{link_authentic, "link_authentic", "the autopilot is connected and authenticated", info,
               "Nadir: searching for the position"},
    ReasonText{link_without_signing, "link_without_signing", "the autopilot is connected; the link is not signed",
               warning, "Nadir: LINK NOT SIGNED, searching position"},
    ReasonText{first_anchor, "first_anchor", "first map match", notice, "Nadir: position found"},
    ReasonText{restored, "restored", "restarted in flight, the saved position is usable", warning,
               "Nadir: restarted, dead reckoning"},
    ReasonText{frame_unfit, "frame_unfit", "the latest frame shows nothing usable", warning,
               "Nadir: camera blind, dead reckoning"},
    ReasonText{camera_silent, "camera_silent", "no frames from the camera", warning,
               "Nadir: no camera frames, dead reckoning"},
    ReasonText{localizer_late, "localizer_late", "frames arrive, but no estimates", warning,
               "Nadir: estimates late, dead reckoning"},
    ReasonText{matcher_failing, "matcher_failing", "matching to the map fails again and again", error,
               "Nadir: MAP MATCHING FAILS, dead reckoning"},
    ReasonText{vision_back, "vision_back", "visual position restored", notice, "Nadir: visual position restored"},
    ReasonText{blind_too_long, "blind_too_long", "blind for too long", critical, "Nadir: NO FIX, blind for too long"},
    ReasonText{sigma_too_large, "sigma_too_large", "the position is too uncertain", critical,
               "Nadir: NO FIX, position too uncertain"},
    ReasonText{localizer_lost, "localizer_lost", "the localizer has lost the position", critical,
               "Nadir: NO FIX, position lost"},
    ReasonText{integrity_lost, "integrity_lost", "no radius holds the position at the mission's risk", critical,
               "Nadir: NO FIX, no protection level"},
    ReasonText{anchored_again, "anchored_again", "matched to the map again, and stable", notice,
               "Nadir: position found again"},
    ReasonText{no_position, "no_position", "no position, neither from vision nor from GPS", emergency,
               "Nadir: FAILSAFE, no position"},
    ReasonText{gps_position, "gps_position", "a trusted GPS provides the position", notice,
               "Nadir: failsafe over, GPS has a position"},
    ReasonText{link_unsigned, "link_unsigned", "messages from the autopilot without a valid signature", error,
               "Nadir: autopilot link not authenticated"},
    ReasonText{link_lost, "link_lost", "no messages from the autopilot", warning, "Nadir: autopilot link lost"},
    ReasonText{link_back, "link_back", "autopilot link restored", info, "Nadir: autopilot link restored"},
    ReasonText{gps_denied, "gps_denied", "GPS is denied", warning, "Nadir: GPS denied"},
    ReasonText{gps_spoofed, "gps_spoofed", "GPS is spoofed", critical, "Nadir: GPS SPOOFED"},
    ReasonText{gps_trusted, "gps_trusted", "GPS is trusted", notice, "Nadir: GPS trusted"},
    ReasonText{vision_leads, "vision_leads", "autopilot now navigating by Nadir", warning,
               "Nadir: autopilot now navigating by Nadir"},
    ReasonText{vision_leads_unconfirmed, "vision_leads_unconfirmed",
               "our position leads, but the autopilot may not use it", critical,
               "Nadir: autopilot may NOT use our position"},
    ReasonText{gps_leads, "gps_leads", "autopilot navigating by GPS again", notice,
               "Nadir: autopilot navigating by GPS"},
    ReasonText{position_not_usable, "position_not_usable", "the protection level is beyond the alert limit", critical,
               "Nadir: POSITION NOT USABLE"},
    ReasonText{position_usable_again, "position_usable_again", "the protection level is within the alert limit again",
               notice, "Nadir: position usable again"},
};

constexpr bool in_order() {
  for (std::size_t i = 0; i < kReasons.size(); ++i) {
    if (static_cast<std::size_t>(kReasons[i].reason) != i) return false;
  }
  return kReasons.size() == static_cast<std::size_t>(position_usable_again) + 1;
}
static_assert(in_order());

}  // namespace

std::span<const ReasonText> all_reasons() { return kReasons; }

const ReasonText& text_of(ServiceReason reason) { return kReasons.at(static_cast<std::size_t>(reason)); }

std::string_view name_of(ServiceState state) {
  switch (state) {
    case ServiceState::boot: return "boot";
    case ServiceState::no_package: return "no_package";
    case ServiceState::awaiting_autopilot: return "awaiting_autopilot";
    case ServiceState::relocalizing: return "relocalizing";
    case ServiceState::normal: return "normal";
    case ServiceState::degraded: return "degraded";
    case ServiceState::no_fix: return "no_fix";
    case ServiceState::failsafe: return "failsafe";
  }
  return "boot";
}

}  // namespace nadir
