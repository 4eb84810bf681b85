// MAVLink messages as plain values, and their encoding. SI units, radians, degrees of longitude and latitude; the wire
// layout comes from the headers that the official generator makes from the official definitions, and those types never
// leave messages.cpp.
//
// An optional field is one that the sender marked as unknown. Times: boot_ms counts from the autopilot's boot, unix_us
// is UTC in microseconds since 1970. Incoming values are not checked for plausibility here, but floating-point fields
// hold NaN or infinity only where a comment says so: any other message with such a number is malformed.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <variant>

#include "geodesy/lon_lat.hpp"
#include "mavlink/frame.hpp"

namespace nadir {

struct Vector3 {
  double x = 0;
  double y = 0;
  double z = 0;

  bool operator==(const Vector3&) const = default;
};

struct NedVelocity {
  double north_mps = 0;
  double east_mps = 0;
  double down_mps = 0;

  bool operator==(const NedVelocity&) const = default;
};

enum class GpsFix : std::uint8_t { no_gps, none, two_d, three_d, dgps, rtk_float, rtk_fixed };
enum class TextSeverity : std::uint8_t { emergency, alert, critical, error, warning, notice, info, debug };
enum class SystemState : std::uint8_t { uninitialized, boot, calibrating, standby, active, critical, emergency };
enum class CommandResult : std::uint8_t { accepted, temporarily_rejected, denied, unsupported, failed, in_progress };

// ---- both directions

struct StatusText {
  TextSeverity severity = TextSeverity::info;
  std::string text{};  // at most 50 bytes in each message
  std::uint16_t id = 0;
  std::uint8_t chunk = 0;
};

struct CommandInt {
  MavlinkAddress target{};
  std::uint16_t command = 0;
  std::uint8_t frame = 0;
  std::array<float, 4> parameters{};
  LonLat place{};
  float z = 0;
};

// The seven parameters may be NaN ("not used").
struct CommandLong {
  MavlinkAddress target{};
  std::uint16_t command = 0;
  std::uint8_t confirmation = 0;
  std::array<float, 7> parameters{};
};

// SET_GPS_GLOBAL_ORIGIN.
struct SetLocalOrigin {
  std::uint8_t target_system = 0;
  LonLat place{};
  double msl_m = 0;
};

// ---- incoming

// The autopilot's software, as its heartbeat names it.
enum class AutopilotType : std::uint8_t { none, ardupilot, px4, other };

struct Heartbeat {
  std::uint8_t vehicle_type = 0;
  bool is_autopilot = false;  // not a ground station, a camera or a companion computer
  AutopilotType autopilot = AutopilotType::none;
  std::uint8_t autopilot_number = 0;  // MAV_AUTOPILOT, for messages about others
  bool armed = false;
  std::uint32_t custom_mode = 0;  // the flight mode, numbered per vehicle type
  SystemState state = SystemState::uninitialized;
};

struct SystemTime {
  std::optional<std::int64_t> unix_us{};
  std::uint32_t boot_ms = 0;
};

// Aerospace angles: roll right wing down, pitch nose up, yaw clockwise from north.
struct AircraftAttitude {
  std::uint32_t boot_ms = 0;
  double roll_rad = 0;
  double pitch_rad = 0;
  double yaw_rad = 0;
  Vector3 rate_rad_s{};
};

// GIMBAL_DEVICE_ATTITUDE_STATUS: of a gimbal whose own axes are ahead (where it looks), right and down.
struct GimbalAttitude {
  std::uint32_t boot_ms = 0;
  std::uint8_t device = 0;  // 0: the sender itself; 1 to 6: gimbals that an autopilot speaks for
  // From the gimbal's axes to level ones: north, east, down; or, not from_north, along the aircraft's heading, to its
  // right, down. w, x, y, z, of length 1.
  std::array<double, 4> level_from_gimbal{};
  bool from_north = false;
  bool faulty = false;  // it reports a fault that its angles may be wrong by
};

// The autopilot's own fused position. It contains our own fixes, so that it must never be used as a measurement.
struct GlobalPosition {
  std::uint32_t boot_ms = 0;
  LonLat place{};
  double msl_m = 0;
  double above_home_m = 0;
  NedVelocity velocity{};
  std::optional<double> heading_rad{};
};

struct GpsRaw {
  int receiver = 1;           // 1 or 2, as ArduPilot counts them
  std::uint64_t time_us = 0;  // since 1970 or since boot
  GpsFix fix = GpsFix::no_gps;
  LonLat place{};
  double msl_m = 0;
  std::optional<double> hdop{};
  std::optional<double> vdop{};
  std::optional<double> ground_speed_mps{};
  std::optional<double> course_rad{};
  std::optional<int> satellites{};
  std::optional<double> horizontal_accuracy_m{};
  std::optional<double> vertical_accuracy_m{};
  std::optional<double> speed_accuracy_mps{};
  std::optional<double> yaw_rad{};
};

// RAW_IMU (any instance) and SCALED_IMU, which ArduPilot sends in milli-g and milliradians per second; HIGHRES_IMU of
// PX4, in SI units.
struct ImuSample {
  int instance = 1;
  std::uint64_t time_us = 0;
  Vector3 acceleration_mps2{};
  Vector3 rate_rad_s{};
};

struct GroundHeight {  // TERRAIN_REPORT
  LonLat place{};
  double terrain_msl_m = 0;
  double above_terrain_m = 0;
};

struct GroundDistance {  // DISTANCE_SENSOR that looks down
  std::uint32_t boot_ms = 0;
  double distance_m = 0;
  double min_m = 0;
  double max_m = 0;
};

// Variances are ArduPilot's normalized innovations: above 1 the filter rejects what it measures.
struct EkfStatus {
  bool attitude = false;
  bool horizontal_velocity = false;
  bool horizontal_position_relative = false;
  bool horizontal_position_absolute = false;
  bool vertical_position = false;
  bool constant_position = false;  // no position estimate
  bool uninitialized = false;
  bool gps_glitching = false;
  double velocity_variance = 0;
  double horizontal_position_variance = 0;
  double vertical_position_variance = 0;
  double compass_variance = 0;
};

// PX4's ESTIMATOR_STATUS.
struct EstimatorStatus {
  bool horizontal_position_absolute = false;
  bool gps_glitching = false;
  double horizontal_position_ratio = 0;  // of the innovation to its gate: above 1 it is rejected. May be NaN
  double horizontal_accuracy_m = 0;      // one sigma. May be NaN
};

// GPS_GLOBAL_ORIGIN: the origin of the autopilot's local frame.
struct LocalOrigin {
  LonLat place{};
  double msl_m = 0;
};

// Autopilots encode integers differently: parameters.hpp.
struct ParameterValue {
  std::string name{};
  float wire_value = 0;  // any bits
  std::uint8_t type = 0;
  int count = 0;
  int index = -1;  // -1: unknown
};

struct AutopilotVersion {
  std::uint64_t capabilities = 0;
  std::uint32_t flight_software = 0;  // major, minor, patch, kind: a byte each from the top
  std::uint32_t board = 0;
  std::uint16_t vendor_id = 0;
  std::uint16_t product_id = 0;
  std::uint64_t uid = 0;
  std::array<std::uint8_t, 18> uid2{};
};

// The first version of PX4 with GLOBAL_POSITION_SENSOR and with signed links: 1.18, as flight_software.
inline constexpr std::uint32_t kPx4GlobalPosition = (1U << 24) | (18U << 16);

// CAMERA_INFORMATION.
struct CameraInformation {
  std::string vendor{};
  std::string model{};
  bool has_video_stream = false;
};

// VIDEO_STREAM_INFORMATION. Texts are the sender's, of any bytes.
struct VideoStream {
  enum class Kind : std::uint8_t { rtsp, rtp_udp, tcp_mpeg, mpeg_ts, other };
  Kind kind = Kind::other;
  int id = 0;     // from 1
  int count = 0;  // of streams that the camera has
  int width = 0;  // pixels; 0: unknown
  int height = 0;
  bool running = false;
  std::string name{};
  std::string uri{};
};

// Ground truth of a simulator.
struct SimState {
  double roll_rad = 0;
  double pitch_rad = 0;
  double yaw_rad = 0;
  Vector3 acceleration_mps2{};
  Vector3 rate_rad_s{};
  LonLat place{};
  double msl_m = 0;
  NedVelocity velocity{};
};

// Valid, but not used here.
struct OtherMessage {
  std::uint32_t id = 0;
};

using IncomingMessage = std::variant<OtherMessage, Heartbeat, SystemTime, AircraftAttitude, GimbalAttitude,
                                     GlobalPosition, GpsRaw, ImuSample, GroundHeight, GroundDistance, EkfStatus,
                                     EstimatorStatus, LocalOrigin, StatusText, ParameterValue, CommandInt, CommandLong,
                                     SetLocalOrigin, AutopilotVersion, CameraInformation, VideoStream, SimState>;

// ---- outgoing

struct OwnHeartbeat {  // as an onboard computer
  SystemState state = SystemState::boot;
};

// A receiver's velocity; a downward-looking camera may not observe the vertical component.
struct GpsVelocity {
  double north_mps = 0;
  double east_mps = 0;
  std::optional<double> down_mps{};

  bool operator==(const GpsVelocity&) const = default;
};

// A GPS fix for the autopilot; gps_input.hpp fills it by the autopilot's rules.
struct GpsInput {
  std::int64_t unix_us = 0;
  std::uint16_t gps_week = 0;
  std::uint32_t gps_week_ms = 0;
  std::uint8_t gps_id = 0;
  GpsFix fix = GpsFix::no_gps;
  LonLat place{};
  std::optional<double> msl_m{};
  std::optional<double> hdop{};
  std::optional<double> vdop{};
  std::optional<GpsVelocity> velocity{};
  std::optional<double> horizontal_accuracy_m{};
  std::optional<double> vertical_accuracy_m{};
  std::optional<double> speed_accuracy_mps{};
  int satellites = 0;
  std::optional<double> yaw_rad{};
};

// A position for PX4's filter, valid when it is sent: GLOBAL_POSITION_SENSOR, source vision.
struct GlobalPositionSensor {
  MavlinkAddress target{};
  std::uint8_t sensor_id = 1;
  std::int64_t unix_us = 0;
  double processing_s = 0;  // from the moment of the position to its sending
  LonLat place{};
  double sigma_m = 0;  // horizontal, one axis
  std::optional<double> msl_m{};
  std::optional<double> vertical_sigma_m{};
};

// A position in the autopilot's local frame, valid when it is sent: ODOMETRY in MAV_FRAME_LOCAL_NED. Attitude and
// velocities are sent as unknown.
struct LocalPosition {
  std::int64_t unix_us = 0;
  double north_m = 0;
  double east_m = 0;
  double down_m = 0;
  double sigma_m = 0;  // horizontal, one axis
  double vertical_sigma_m = 0;
  std::uint8_t reset_counter = 0;  // another number: the position has jumped
};

struct CommandAck {
  std::uint16_t command = 0;
  CommandResult result = CommandResult::accepted;
  MavlinkAddress target{};  // the sender of the command
};

struct ParameterRequest {
  MavlinkAddress target{};
  std::string name{};  // at most 16 bytes
};

struct ParameterSet {
  MavlinkAddress target{};
  std::string name{};  // at most 16 bytes
  float wire_value = 0;
  std::uint8_t type = 9;  // that of the ParameterValue; ArduPilot takes any
};

// A figure for people: ground stations show and plot it under its name.
struct NamedValue {
  std::uint32_t boot_ms = 0;
  std::string name{};  // at most 10 bytes
  float value = 0;
};

// Contains the secret key: send it over a private link only, and never log it.
struct SigningSetup {
  MavlinkAddress target{};
  std::array<std::uint8_t, 32> key{};
  std::uint64_t timestamp_10us = 0;
};

using OutgoingMessage =
    std::variant<OwnHeartbeat, GpsInput, GlobalPositionSensor, LocalPosition, SetLocalOrigin, StatusText, CommandLong,
                 CommandInt, CommandAck, ParameterRequest, ParameterSet, NamedValue, SigningSetup>;

// ---- on the wire

// Decodes a frame. nullopt: malformed, a NaN or infinity where a number is required. Fields that the sender left out
// (version 2 truncates trailing zeros, version 1 has no extensions) are zero or unknown.
std::optional<IncomingMessage> decode(const MavlinkFrame& frame);

// Encodes a version 2 frame without a signature; signing.hpp signs it. Values beyond a field's range are clamped, long
// texts are cut between two UTF-8 characters.
Bytes encode(const OutgoingMessage& message, MavlinkAddress from, std::uint8_t sequence);

}  // namespace nadir
