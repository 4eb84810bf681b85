// The autopilot's side of messages.hpp, for simulators: what an autopilot sends is encoded, what a companion sends to
// it is decoded.
#pragma once

#include <optional>
#include <variant>

#include "mavlink/messages.hpp"

namespace nadir {

// Those that simulators send: Heartbeat, SystemTime, AircraftAttitude, GlobalPosition, GpsRaw, ImuSample (RAW_IMU of
// ArduPilot, HIGHRES_IMU of PX4), EkfStatus, EstimatorStatus, ParameterValue, AutopilotVersion, SimState. nullopt: any
// other. A version 2 frame without a signature; values beyond a field's range are clamped.
std::optional<Bytes> encode_from_autopilot(AutopilotType type, const IncomingMessage& message, MavlinkAddress from,
                                           std::uint8_t sequence);

// What a companion sends to an autopilot; monostate: anything else, or malformed.
using CompanionMessage =
    std::variant<std::monostate, GpsInput, GlobalPositionSensor, CommandLong, ParameterRequest, ParameterSet>;
CompanionMessage decode_from_companion(const MavlinkFrame& frame);

// A command that asks for messages of a kind: at a rate, 0 being the usual one and below 0 none, or, without a period,
// once. nullopt: another command.
struct StreamRequest {
  std::uint32_t message_id = 0;
  std::optional<double> period_s{};
};
std::optional<StreamRequest> stream_request(const CommandLong& command);

}  // namespace nadir
