// Poses from a MAVLink stream: mavlink/endpoint.hpp says how its address is written. The link is unsigned, for
// simulators. An autopilot that is heard is asked for the messages that are needed, until they come.
#pragma once

#include <optional>
#include <string_view>

#include "mavlink/link.hpp"
#include "commands/simulate/camera_pose/pose_assembler.hpp"

namespace nadir {

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
