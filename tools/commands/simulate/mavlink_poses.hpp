// Poses of a camera that looks straight down from an aircraft, from the messages of an autopilot or its simulator.
//
// SIM_STATE is a simulator's truth and is taken as it is. While none comes, the autopilot's own position
// (GLOBAL_POSITION_INT) is propagated with its velocity to the time of each ATTITUDE. Both count heights above the sea,
// as the elevation model must.
//
// A pose's time is the autopilot's UTC (SYSTEM_TIME) once it is known, else this machine's. SIM_STATE has no time
// stamp: its time of arrival is used.
//
// Poses from a MAVLink stream: mavlink/transport.hpp says how its address is written. The link is unsigned, for
// simulators. Once its heartbeat arrives, the autopilot is asked for the messages that are needed, until they come.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "mavlink/link.hpp"
#include "mavlink/messages.hpp"
#include "simulation/camera_simulation.hpp"

namespace nadir {

class PoseAssembler {
 public:
  // monotonic_us: of a steady clock; unix_us: this machine's UTC; both at the message's arrival.
  std::optional<LivePose> on_message(const IncomingMessage& message, std::int64_t monotonic_us, std::int64_t unix_us);

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

class MavlinkPoseSource final : public PoseSource {
 public:
  // Throws UsageError for an address that cannot be read, Error for one that cannot be listened at.
  explicit MavlinkPoseSource(std::string_view endpoint);

  std::optional<LivePose> latest(std::chrono::milliseconds timeout) override;

 private:
  void take_what_came();
  void keep_in_touch(std::int64_t now_us);

  MavlinkLink link_;
  PoseAssembler assembler_;
  std::optional<LivePose> newest_;
  std::optional<MavlinkAddress> autopilot_;
  std::int64_t next_heartbeat_us_ = 0;
  std::int64_t last_pose_us_ = 0;
};

}  // namespace nadir
