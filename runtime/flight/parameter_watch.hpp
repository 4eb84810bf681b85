// Whether the autopilot's parameters are still those that provisioning found or set: the airframe file lists them.
// Asked for while the aircraft is disarmed, a few with each heartbeat, all of them again and again: a ground station
// may change one at any time. In flight only what has not been answered yet is asked for, after a restart.
//
// A parameter is missing when the autopilot does not answer five requests for it in a row although it answered later
// requests for others: an autopilot that is slow answers in order, and a lost link answers nothing. An autopilot that
// answers heartbeat after heartbeat no request at all, for a minute, has none of them.
//
// PX4 takes our position by other parameters from 1.18 on (EKF2_AGPn_…) than before (EKF2_EV_…). Which ones the file
// lists says for which version it was made. The version is asked for again and again, too: PX4 may be updated while
// this program runs. With the wrong version parameters are missing by design, and that alone is reported.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "mavlink/parameters.hpp"
#include "service/onboard_event.hpp"
#include "vision/camera.hpp"

namespace nadir {

class ParameterWatch {
 public:
  ParameterWatch(const std::vector<AirframeParameter>& expected, MavlinkAddress autopilot);

  struct Turn {
    std::vector<OutgoingMessage> requests;     // what to send now
    std::optional<ParametersMissing> missing;  // found missing since the last heartbeat
  };
  Turn on_heartbeat(double now_s, const Heartbeat& heartbeat);

  // An event when the parameter differs, differs in another way, or is as expected again. ours: we have set this value
  // ourselves, for a time (gps_fusion_switch.hpp): no difference.
  std::optional<ParameterChanged> on_message(const ParameterValue& value, bool ours = false);

  // An event when the version is not the one that the parameters were made for, or is again.
  std::optional<AutopilotVersionChanged> on_message(const AutopilotVersion& version);

  ParameterCheck check() const;

 private:
  struct Watched {
    AirframeParameter expected;
    bool known = false;  // answered, since the start
    bool missing = false;
    std::optional<double> different{};     // what it is instead
    std::optional<std::uint64_t> asked{};  // number of the last request, while it has no answer
    int unanswered = 0;                    // requests in a row, while others were answered
  };

  bool wrong_version() const;
  void ask(Watched& parameter);
  void forget_requests();
  std::optional<ParametersMissing> newly_missing();

  std::vector<Watched> parameters_;
  MavlinkAddress autopilot_;
  ParameterEncoding encoding_ = ParameterEncoding::cast;
  std::size_t next_ = 0;
  std::uint64_t requests_ = 0, answered_ = 0;  // answered_: number of the latest request with an answer
  int silent_heartbeats_ = 0;                  // with requests, since the last answer
  std::optional<double> heartbeat_s_;
  std::optional<bool> made_for_global_position_;  // nullopt: the file lists none of the parameters that tell
  std::optional<std::uint32_t> version_;          // of PX4
  int heartbeats_until_version_ = 0;
};

}  // namespace nadir
