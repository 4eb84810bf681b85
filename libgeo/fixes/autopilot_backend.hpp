// What is particular to one kind of autopilot: which telemetry is requested, and in which messages a fix reaches its
// filter. Everything else of the link is the same for all.
//
//   ArduPilot   GPS_INPUT: our fix is one of its GPS receivers. "No fix" is sent.
//   PX4         GLOBAL_POSITION_SENSOR from 1.18 on, before ODOMETRY in its local frame: a source of its filter beside
//               GPS (px4_backend.hpp). "No fix" is silence.
//
// The kind is known by the autopilot's HEARTBEAT; any other than these is refused.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "fixes/fix_stream.hpp"
#include "mavlink/commands.hpp"

namespace nadir {

struct MessageRate {
  StreamedMessage message;
  double rate_hz = 0;
};

class AutopilotBackend {
 public:
  virtual ~AutopilotBackend() = default;

  virtual AutopilotType type() const = 0;
  virtual std::string_view name() const = 0;
  virtual std::span<const MessageRate> streams() const = 0;  // to request

  // What the autopilot says about itself. Of its own messages only.
  virtual void on_message(std::int64_t now_us, const IncomingMessage& message) = 0;

  // What carries this fix. Empty: silence is what says "no fix". nullopt: it cannot be sent yet, missing() says why.
  virtual std::optional<std::vector<OutgoingMessage>> messages(const DueFix& due) = 0;

  // What must be asked of the autopilot now. Call it with every fix that is due.
  virtual std::vector<OutgoingMessage> requests(std::int64_t now_us, const DueFix& due) = 0;

  // Without it no fix can be sent; empty: nothing is missing.
  virtual std::string missing() const = 0;
};

// null: the type is not supported. gps_id: of the airframe file; for PX4 the slot of the auxiliary position.
std::unique_ptr<AutopilotBackend> make_autopilot_backend(AutopilotType type, MavlinkAddress autopilot,
                                                         std::uint8_t gps_id);

constexpr bool is_supported(AutopilotType type) {
  return type == AutopilotType::ardupilot || type == AutopilotType::px4;
}
std::string_view supported_autopilots();                    // for messages
std::string name_of_autopilot(const Heartbeat& heartbeat);  // "PX4"; of another: "MAV_AUTOPILOT 12"

// Whether a receiver of the autopilot is the aircraft's own one, of which GPS is judged. ArduPilot plays our fix back
// as the receiver of gps_id; PX4 never does, and its second receiver is not judged.
constexpr bool is_real_receiver(AutopilotType type, const GpsRaw& gps, std::uint8_t gps_id) {
  return type == AutopilotType::px4 ? gps.receiver == 1 : gps.receiver != gps_id + 1;
}

}  // namespace nadir
