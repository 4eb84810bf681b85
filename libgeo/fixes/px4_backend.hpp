// PX4: our fix is a source of its filter (EKF2) beside GPS.
//
// From 1.18 on: GLOBAL_POSITION_SENSOR, fused as auxiliary global position. Sensor id and slot: EKF2_AGPn_ID = n + 1
// for n = gps_id of the airframe file. σ is `eph`; PX4 takes the larger of it and EKF2_AGPn_NOISE. A source that is
// silent for 5 s stops (EKF2/EKF/aid_sources/aux_global_position/aux_global_position_control.cpp).
//
// Before: ODOMETRY in MAV_FRAME_LOCAL_NED, fused as external vision (ev_pos_control.cpp). Its metres count from the
// origin of PX4's local frame, which PX4 reports (GPS_GLOBAL_ORIGIN). When it has none, because it has had no GPS, we
// set one at our first fix. Nothing is sent before it is reported, nor when it no longer is, after a restart of PX4.
// When it moves, the position counts from the new one with another reset_counter. An announced jump has another
// reset_counter too: PX4 resets to it at once.
//
// Position alone is sent: PX4's attitude and velocity come from its own sensors, and ours depend on them.
//
// Versions are those of AUTOPILOT_VERSION, without which nothing is sent. Times are those of a steady clock.
#pragma once

#include "fixes/autopilot_backend.hpp"

namespace nadir {

// North and east as PX4 computes them from an origin (lib/geo/geo.cpp, MapProjection): azimuthal equidistant on a
// sphere of 6371 km. Not metres on the ellipsoid: 10 km away these are some 30 m different.
struct Px4Plane {
  double north_m = 0, east_m = 0;
};
Px4Plane px4_plane(LonLat origin, LonLat place);

class Px4Backend final : public AutopilotBackend {
 public:
  Px4Backend(MavlinkAddress autopilot, std::uint8_t gps_id) : autopilot_(autopilot), gps_id_(gps_id) {}

  AutopilotType type() const override { return AutopilotType::px4; }
  std::string_view name() const override { return "PX4"; }
  std::span<const MessageRate> streams() const override;
  void on_message(std::int64_t now_us, const IncomingMessage& message) override;
  std::optional<std::vector<OutgoingMessage>> messages(const DueFix& due) override;
  std::vector<OutgoingMessage> requests(std::int64_t now_us, const DueFix& due) override;
  std::string missing() const override;

 private:
  bool takes_global_position() const { return version_ && *version_ >= kPx4GlobalPosition; }

  MavlinkAddress autopilot_;
  std::uint8_t gps_id_;
  std::optional<std::uint32_t> version_;  // flight_software of AUTOPILOT_VERSION
  std::optional<LocalOrigin> origin_;
  std::int64_t origin_us_ = 0;                    // when it was last reported
  std::optional<std::int64_t> origin_wanted_us_;  // since when it has been missing
  std::uint8_t reset_counter_ = 0;
  std::int64_t next_request_us_ = 0;
};

}  // namespace nadir
