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
    ReasonText{package_verified, "package_verified", "the package is signed and whole", info, ""},
    ReasonText{package_refused, "package_refused", "the package does not verify", critical,
               "Nadir: map package refused, no position"},
    ReasonText{link_authentic, "link_authentic", "the autopilot speaks and is who it says", info,
               "Nadir: looking for the position"},
    ReasonText{first_anchor, "first_anchor", "a picture was found on the map", notice, "Nadir: position found"},
    ReasonText{restored, "restored", "restarted in flight, the saved position is still good", warning,
               "Nadir: restarted, dead reckoning"},
    ReasonText{frame_unfit, "frame_unfit", "the newest picture shows nothing to go by", warning,
               "Nadir: camera blind, dead reckoning"},
    ReasonText{camera_silent, "camera_silent", "the camera gives no pictures", warning,
               "Nadir: no pictures, dead reckoning"},
    ReasonText{localizer_late, "localizer_late", "pictures come, but no estimates", warning,
               "Nadir: estimates late, dead reckoning"},
    ReasonText{vision_back, "vision_back", "pictures have carried the position again for a while", notice,
               "Nadir: camera sees again"},
    ReasonText{blind_too_long, "blind_too_long", "blind for too long", critical, "Nadir: NO FIX, blind for too long"},
    ReasonText{sigma_too_large, "sigma_too_large", "the position is too unsure to be told", critical,
               "Nadir: NO FIX, position too unsure"},
    ReasonText{localizer_lost, "localizer_lost", "the localizer has no position", critical, "Nadir: NO FIX, lost"},
    ReasonText{anchored_again, "anchored_again", "found on the map again, and steady for a while", notice,
               "Nadir: position found again"},
    ReasonText{no_position, "no_position", "no position, neither from pictures nor from GPS", emergency,
               "Nadir: FAILSAFE, no position at all"},
    ReasonText{gps_position, "gps_position", "GPS is trusted and tells the position", notice,
               "Nadir: failsafe over, GPS has a position"},
    ReasonText{link_unsigned, "link_unsigned", "the autopilot speaks, but not signed by a key that we know", error,
               "Nadir: autopilot link not signed, waiting"},
    ReasonText{link_lost, "link_lost", "nothing from the autopilot", warning, "Nadir: autopilot link was lost"},
    ReasonText{link_back, "link_back", "the autopilot speaks again", info, "Nadir: autopilot link is back"},
    ReasonText{gps_denied, "gps_denied", "GPS is denied", warning, "Nadir: GPS denied"},
    ReasonText{gps_spoofed, "gps_spoofed", "GPS is spoofed", critical, "Nadir: GPS SPOOFED"},
    ReasonText{gps_trusted, "gps_trusted", "GPS can be trusted", notice, "Nadir: GPS trusted"},
    ReasonText{vision_leads, "vision_leads", "our fix is promoted: the autopilot goes by it", warning,
               "Nadir: flying by map"},
    ReasonText{gps_leads, "gps_leads", "the autopilot goes by GPS again", notice, "Nadir: flying by GPS"},
};

constexpr bool in_order() {
  for (std::size_t i = 0; i < kReasons.size(); ++i) {
    if (static_cast<std::size_t>(kReasons[i].reason) != i) return false;
  }
  return kReasons.size() == static_cast<std::size_t>(gps_leads) + 1;
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
