// What happens to a flight: the facts that the state machine goes by. Each thread reports its own; none of them waits.
#pragma once

#include <string>
#include <string_view>
#include <variant>

#include "estimation/source_label.hpp"

namespace nadir {

// What gps_health thinks of the aircraft's real receiver.
enum class GpsVerdict {
  unknown,  // not heard of yet
  trusted,
  denied,   // silent, without a fix, or given up by the autopilot
  spoofed,  // tells what cannot be
};

std::string_view name_of(GpsVerdict verdict);

struct PackageJudged {
  bool verified = false;
  std::string why{};  // it was refused: the first finding
};

// The autopilot spoke. authentic: signed by a key that we know, or by a link on which no signature is asked for.
struct AutopilotHeard {
  bool authentic = false;
  bool armed = false;
};

// The camera gave a picture; nothing is known about it yet.
struct FrameArrived {};

// The localizer spoke about a picture. sigma_m: one axis; NaN, infinite and negative ones are no position. anchored: it
// is from a place on the map, found just now, if not in this very picture: where a look at the map takes longer than
// from one picture to the next, no estimate is ever labelled satellite_anchored.
struct EstimateMade {
  SourceLabel source = SourceLabel::no_fix;
  double sigma_m = 0;
  bool anchored = false;
};

// The service was started again in flight, and what it had saved is good for a position (restart.hpp). It stands still
// while the aircraft flies on, so σ grows by the speed until the localizer speaks.
struct EstimateRestored {
  double sigma_m = 0;
  double speed_m_per_s = 0;
};

struct GpsJudged {
  GpsVerdict verdict = GpsVerdict::unknown;
  std::string why{};
};

using ServiceFact =
    std::variant<PackageJudged, AutopilotHeard, FrameArrived, EstimateMade, EstimateRestored, GpsJudged>;

}  // namespace nadir
