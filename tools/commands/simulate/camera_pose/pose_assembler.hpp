// Poses of a camera that looks straight down from an aircraft, from what an autopilot or its simulator tells.
//
// SIM_STATE is a simulator's truth and is taken as it is. While none comes, the autopilot's own position
// (GLOBAL_POSITION_INT) is carried by its velocity to the time of each ATTITUDE. Both count heights above the sea, as
// the elevation model must.
//
// A pose's time is the autopilot's UTC (SYSTEM_TIME) once it is known, else this machine's. SIM_STATE carries no time:
// it is taken for the moment at which it arrives.
#pragma once

#include <cstdint>
#include <optional>

#include "mavlink/messages.hpp"
#include "simulation/camera_simulation.hpp"

namespace nadir {

class PoseAssembler {
 public:
  // monotonic_us: of a steady clock; unix_us: this machine's UTC; both at the message's arrival.
  std::optional<LivePose> hear(const IncomingMessage& message, std::int64_t monotonic_us, std::int64_t unix_us);

 private:
  // A pair of times that mean the same moment.
  struct Tie {
    std::int64_t from_us = 0;
    std::int64_t unix_us = 0;
  };

  LivePose pose_of(const SimState& state, std::int64_t monotonic_us, std::int64_t unix_us) const;
  std::optional<LivePose> pose_of(const AircraftAttitude& attitude, std::int64_t monotonic_us,
                                  std::int64_t unix_us) const;

  std::optional<Tie> by_arrival_, by_boot_;  // the autopilot's UTC
  std::optional<std::int64_t> last_truth_us_;
  std::optional<GlobalPosition> position_;
};

}  // namespace nadir
