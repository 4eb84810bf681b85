// What a simulated aircraft says and hears over MAVLink as ArduPlane or PX4: telemetry, the positions that it is given,
// and the truth for the camera. No signatures: the links stay on this machine.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "geodesy/local_frame.hpp"
#include "mavlink/autopilot_side.hpp"
#include "mavlink/commands.hpp"
#include "mavlink/transport.hpp"
#include "simulation/simulated_aircraft.hpp"
#include "vision/camera.hpp"

namespace nadir {

class LoopAutopilot {
 public:
  // frame: of the aircraft's plane. Both outlive it. Throws Error when there is no port.
  LoopAutopilot(AutopilotType type, SimulatedAircraft& aircraft, const LocalFrame& frame);

  // As `nadir provision autopilot` leaves one.
  static std::vector<AirframeParameter> provisioned(AutopilotType type);

  // For the other ends, "udpout:127.0.0.1:PORT".
  std::string link_endpoint() const { return endpoint_of(*link_.transport); }
  std::string truth_endpoint() const { return endpoint_of(*truth_.transport); }

  // After each step of the aircraft: reads what came, sends what is due. truth: for the camera as well.
  void turn(std::int64_t unix_us, bool truth);

  // What has come since the last call.
  std::vector<GivenPosition> take_given();
  std::vector<std::string> take_texts();

 private:
  struct End {
    std::unique_ptr<Transport> transport;
    std::uint8_t sequence = 0;
    FrameReader reader{};
  };
  struct Stream {
    double usual_s = 1, period_s = 1, next_s = 0;
  };

  static End end();
  static std::string endpoint_of(const Transport& transport);
  void receive();
  void take(const MavlinkFrame& frame);
  void take_given_position(LonLat place, double sigma_m, const std::optional<GpsVelocity>& velocity,
                           double speed_sigma_mps);
  void obey(const CommandLong& command, MavlinkAddress sender);
  void answer_parameter(const std::string& name);
  void send(End& end, const IncomingMessage& message);
  std::optional<IncomingMessage> message_of(StreamedMessage kind);

  AutopilotType type_;
  SimulatedAircraft& aircraft_;
  const LocalFrame& frame_;
  End link_ = end(), truth_ = end();
  std::map<StreamedMessage, Stream> streams_;
  std::int64_t unix_us_ = 0;
  double next_heartbeat_s_ = 0, next_truth_s_ = 0, home_altitude_m_;
  std::map<std::string, double, std::less<>> parameters_;
  std::vector<GivenPosition> given_;
  std::vector<std::string> texts_;
};

}  // namespace nadir
