// What happens on board: one type of event for the whole runtime. The threads of camera, link and localizer publish it,
// the conductor (flight/flight_service.hpp) dispatches it, and the state machine, GpsHealth, the journal (recorder,
// event list, operator) and the view of the API each take what concerns them in their on_event().
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "estimation/estimate.hpp"
#include "estimation/telemetry.hpp"
#include "geodesy/lon_lat.hpp"
#include "geodesy/web_mercator.hpp"
#include "service/service_state.hpp"

namespace nadir {

// ---- package and restart

struct PackageVerified {
  bool accepted = false;
  std::string reason{};  // of a rejection: the first finding
};

// There was no package, and one can be opened now.
struct PackageRestored {};

// After a restart in flight the saved position is usable (saved_flight.hpp). It is fixed while the aircraft flies on,
// so σ grows by the speed until the first estimate.
struct EstimateRestored {
  double sigma_m = 0;
  double speed_mps = 0;
};

// A part that the flight can do without has failed, or works again (retried_part.hpp).
struct PartReported {
  std::string part;     // "API"
  std::string failure;  // empty: it works again
  double off_s = 0;     // then: for how long it did not
};

// ---- autopilot

// How we know that a message is the autopilot's.
enum class LinkAuthentication {
  missing,       // the link is signed, the message is not: it is ignored
  not_required,  // the link is not signed (--unsigned-link): anybody on it may have sent the message
  signature,     // signed with our key
};

struct AutopilotHeartbeat {
  LinkAuthentication authentication = LinkAuthentication::missing;
  bool armed = false;
};

// Somebody at another address claims to be the autopilot while it is connected.
struct LinkRivalSeen {
  std::uint64_t frames = 0;  // of rivals since the start
};

// A parameter of the autopilot is not, or again, what the airframe file says.
struct ParameterChanged {
  std::string name;
  double expected = 0;
  double found = 0;  // equal: it is again

  bool restored() const { return found == expected; }
};

// The autopilot does not answer for these parameters, which the airframe file lists.
struct ParametersMissing {
  std::vector<std::string> names;  // not empty
  bool all = false;                // it answers for none of those that the file lists
};

// PX4's version is not, or again, one that the parameters of the airframe file were made for.
struct AutopilotVersionChanged {
  std::string version;   // "1.16.0"
  std::string expected;  // "1.18 or later"
  bool as_expected = false;
};

// Whether the autopilot is set to use our position, as far as its parameters tell (flight/parameter_watch.hpp).
enum class ParameterCheck {
  none_listed,     // the airframe file lists no parameters: nothing is compared
  pending,         // not all have been compared yet
  as_provisioned,  // all are as the airframe file says
  deviating,       // one differs or is missing, or PX4's version is another
};

struct ParametersCompared {
  ParameterCheck check = ParameterCheck::none_listed;
};

// GPS_RAW_INT of a real receiver, never of the fixes that we send.
struct GpsFix3d {
  double time_s = 0;
  bool has_fix = false;  // three-dimensional or better
  LonLat place;
  std::optional<double> ground_speed_mps;
  std::optional<double> accuracy_m;  // horizontal, one sigma
};

// EKF_STATUS_REPORT of ArduPilot, ESTIMATOR_STATUS of PX4.
struct EkfReport {
  double time_s = 0;
  bool has_position = false;  // absolute, horizontal
  bool gps_glitch = false;
};

// An approximate position from the operator, the API or a trusted GPS: where to search first.
struct PositionHinted {
  LonLat place;
  double radius_m = 0;
  std::string source;  // "API", "GPS", "restart", "operator 255/190" (system and component of the sender)
};

// A hint of a ground station that is not taken.
struct HintRefused {
  std::string reason;  // "outside the map"
  std::string source;
};

// The next fix lies so far from the last one: too far to be smoothed.
struct FixJumped {
  double distance_m = 0;
};

// ---- camera and localizer

struct FrameReceived {};

struct CameraFailed {
  std::string reason;
};

// The result for a frame, or of a map match, which takes longer than a frame and comes back later. Where matches take
// longer than the frame interval, no estimate is ever labelled satellite_anchored: the anchor's verdict counts.
struct LocalizedFrame {
  std::uint64_t index = 0;         // of the last processed frame
  std::uint64_t anchor_index = 0;  // of the frame that report.anchor is about
  bool late = false;               // a map match came back; the frame itself was reported before
  Telemetry telemetry;             // of the last processed frame
  FrameReport report;
};

// A match of a frame to the map ended with an exception: nothing was measured.
struct MatchFailed {
  std::string reason;
};

// A tile that is read in flight is not the signed one, or cannot be read. The map has a hole there.
struct TileCorrupt {
  TileKey tile;
  std::string code;  // of the finding: artifact.hash, sqlite.corrupt, tiff.corrupt
  std::string reason;
};

// ---- conclusions of the service

enum class GpsVerdict {
  unknown,  // no message yet
  trusted,
  denied,   // silent, without a fix, or given up by the autopilot
  spoofed,  // reports the impossible
};

std::string_view name_of(GpsVerdict verdict);

struct GpsAssessment {
  GpsVerdict verdict = GpsVerdict::unknown;
  std::string reason{};
};

struct StateTransition {
  double time_s = 0;
  ServiceState from = ServiceState::boot;
  ServiceState to = ServiceState::boot;  // equal: a notice that changes no state
  ServiceReason reason = ServiceReason::started;
  std::string text;  // for the recorder: the explanation, with figures
};

using OnboardEvent =
    std::variant<PackageVerified, PackageRestored, EstimateRestored, PartReported, AutopilotHeartbeat, LinkRivalSeen,
                 ParameterChanged, ParametersMissing, AutopilotVersionChanged, ParametersCompared, GpsFix3d, EkfReport,
                 PositionHinted, HintRefused, FixJumped, FrameReceived, CameraFailed, LocalizedFrame, MatchFailed,
                 TileCorrupt, GpsAssessment, StateTransition>;

struct TimedEvent {
  double time_s = 0;  // monotonic, when it was published
  OnboardEvent event;
};

// Whether an estimate is based on images: satellite_anchored and vo_extrapolated.
constexpr bool is_visual(SourceLabel source) {
  return source == SourceLabel::satellite_anchored || source == SourceLabel::vo_extrapolated;
}

}  // namespace nadir
