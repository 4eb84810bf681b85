// Position hints from ground stations: which messages are one, and which of them are taken.
//
//   MAV_CMD_EXTERNAL_POSITION_ESTIMATE   "Set Position" on MAVProxy's map; its accuracy is the radius. Its age widens
//                                        the radius: the aircraft has flown on since
//   SET_GPS_GLOBAL_ORIGIN                "Set Estimator Origin" on QGroundControl's map, while there is no position: an
//                                        origin is where the aircraft is for those alone who know of no other place
//
// A hint must be meant for us, of the recent past, and touch the mission's area. Whether it is signed is the link's
// business: a signed link passes on nothing else. For one thread.
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "geodesy/lon_lat.hpp"
#include "mavlink/link.hpp"
#include "service/onboard_event.hpp"
#include "service/position_hints.hpp"

namespace nadir {

class HintIntake {
 public:
  // distance_m: from a place to the mission's area, 0 within it. Null: there is no map, every place will do.
  using MapDistance = std::function<double(const LonLat&)>;

  explicit HintIntake(MavlinkAddress own, MapDistance distance_m = nullptr)
      : own_(own), distance_m_(std::move(distance_m)) {}

  struct Answer {
    std::optional<PositionHinted> hint;
    std::optional<CommandAck> acknowledgement;  // of a command
    std::string refusal{};                      // why it is not taken; for the operator
  };
  // position_known: a position of ours may be sent.
  Answer on_message(double now_s, const ReceivedMessage& received, bool position_known);

 private:
  Answer on_command(double now_s, const ReceivedMessage& received, const CommandInt& command);
  Answer on_origin(double now_s, const ReceivedMessage& received, const SetLocalOrigin& origin);

  MavlinkAddress own_;
  MapDistance distance_m_;
  HintAllowance allowance_;
};

}  // namespace nadir
