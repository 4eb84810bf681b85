#include "fixes/autopilot_backend.hpp"

#include <array>
#include <string>

#include "fixes/px4_backend.hpp"

namespace nadir {
namespace {

// ArduPlane sends at most every 20 ms, and warns the operator about any request above 40 Hz.
constexpr std::array<MessageRate, 9> kArdupilotStreams{{
    {StreamedMessage::attitude, 25},
    {StreamedMessage::global_position, 5},
    {StreamedMessage::gps_raw, 5},
    {StreamedMessage::gps2_raw, 5},
    {StreamedMessage::raw_imu, 40},
    {StreamedMessage::ekf_status, 4},
    {StreamedMessage::terrain_report, 2},
    {StreamedMessage::distance_sensor, 5},
    {StreamedMessage::system_time, 1},
}};

class ArdupilotBackend final : public AutopilotBackend {
 public:
  AutopilotType type() const override { return AutopilotType::ardupilot; }
  std::string_view name() const override { return "ArduPilot"; }
  std::span<const MessageRate> streams() const override { return kArdupilotStreams; }
  void on_message(std::int64_t, const IncomingMessage&) override {}
  std::optional<std::vector<OutgoingMessage>> messages(const DueFix& due) override {
    return std::vector<OutgoingMessage>{due.message};
  }
  std::vector<OutgoingMessage> requests(std::int64_t, const DueFix&) override { return {}; }
  std::string missing() const override { return {}; }
};

}  // namespace

std::unique_ptr<AutopilotBackend> make_autopilot_backend(AutopilotType type, MavlinkAddress autopilot,
                                                         std::uint8_t gps_id) {
  switch (type) {
    case AutopilotType::ardupilot: return std::make_unique<ArdupilotBackend>();
    case AutopilotType::px4: return std::make_unique<Px4Backend>(autopilot, gps_id);
    default: return nullptr;
  }
}

std::string_view supported_autopilots() { return "ArduPilot or PX4"; }

std::string name_of_autopilot(const Heartbeat& heartbeat) {
  switch (heartbeat.autopilot) {
    case AutopilotType::ardupilot: return "ArduPilot";
    case AutopilotType::px4: return "PX4";
    default: return "MAV_AUTOPILOT " + std::to_string(heartbeat.autopilot_number);
  }
}

}  // namespace nadir
