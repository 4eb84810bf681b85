#include "commands/simulate/loop_autopilot.hpp"

#include <array>
#include <cmath>
#include <utility>

#include "base/error.hpp"
#include "mavlink/parameters.hpp"
#include "provision/autopilot_provisioning.hpp"

namespace nadir {
namespace {

constexpr MavlinkAddress kAutopilot{1, 1};
constexpr std::uint8_t kFixedWingType = 1;  // MAV_TYPE_FIXED_WING
constexpr std::uint32_t kPlaneAuto = 10;    // custom modes: ArduPlane's AUTO, PX4's mission
constexpr std::uint32_t kPx4Mission = (4U << 16) | (4U << 24);
constexpr std::uint8_t kInt32Parameter = 6, kFloatParameter = 9;  // MAV_PARAM_TYPE_INT32, REAL32
constexpr const char* kGpsControl = "EKF2_GPS_CTRL";
constexpr double kGpsUsed = 7;  // of it: position, height and velocity
constexpr double kTruthPeriod_s = 0.04, kBootedBefore_s = 30;
constexpr double kGpsAccuracy_m = 1.2, kGpsVerticalAccuracy_m = 2.2, kGpsSpeedAccuracy_mps = 0.3;

// Messages a second, as they usually come; a companion may ask for other rates.
constexpr std::array<std::pair<StreamedMessage, double>, 6> kArduplaneRates{{{StreamedMessage::system_time, 1},
                                                                             {StreamedMessage::attitude, 25},
                                                                             {StreamedMessage::global_position, 10},
                                                                             {StreamedMessage::gps2_raw, 5},
                                                                             {StreamedMessage::raw_imu, 50},
                                                                             {StreamedMessage::ekf_status, 5}}};
constexpr std::array<std::pair<StreamedMessage, double>, 6> kPx4Rates{{{StreamedMessage::system_time, 1},
                                                                       {StreamedMessage::attitude, 50},
                                                                       {StreamedMessage::global_position, 50},
                                                                       {StreamedMessage::gps_raw, 5},
                                                                       {StreamedMessage::highres_imu, 50},
                                                                       {StreamedMessage::estimator_status, 1}}};

Vector3 vector3(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

}  // namespace

LoopAutopilot::LoopAutopilot(AutopilotType type, SimulatedAircraft& aircraft, const LocalFrame& frame)
    : type_(type), aircraft_(aircraft), frame_(frame), home_altitude_m_(aircraft.body().altitude_m()) {
  for (const auto& [kind, rate_hz] : type == AutopilotType::px4 ? kPx4Rates : kArduplaneRates) {
    streams_[kind] = {1 / rate_hz, 1 / rate_hz, 0};
  }
  for (const AirframeParameter& parameter : provisioned(type)) parameters_[parameter.name] = parameter.value;
}

std::vector<AirframeParameter> LoopAutopilot::provisioned(AutopilotType type) {
  AutopilotIdentity autopilot;
  autopilot.type = type;
  autopilot.software = kPx4GlobalPosition;
  std::vector<AirframeParameter> listed;
  for (const AutopilotParameter& one : wanted_parameters(autopilot, 1)) {
    listed.push_back({one.name, one.kept ? kGpsUsed : one.bits != 0 ? one.bits : one.wanted});
  }
  return listed;
}

LoopAutopilot::End LoopAutopilot::end() {
  End end{make_transport(parse_endpoint("udpin:127.0.0.1:0"))};
  end.transport->advance(0, [](const Transport::Arrival&) {});
  if (!end.transport->is_open()) throw Error({.what = "cannot open a port", .found = end.transport->last_error()});
  return end;
}

std::string LoopAutopilot::endpoint_of(const Transport& transport) {
  return "udpout:127.0.0.1:" + std::to_string(transport.local_port());
}

std::vector<GivenPosition> LoopAutopilot::take_given() { return std::exchange(given_, {}); }
std::vector<std::string> LoopAutopilot::take_texts() { return std::exchange(texts_, {}); }

void LoopAutopilot::turn(std::int64_t unix_us, bool truth) {
  unix_us_ = unix_us;
  receive();
  const double now_s = aircraft_.now_s();
  if (now_s >= next_heartbeat_s_) {
    next_heartbeat_s_ = now_s + 1;
    send(link_, Heartbeat{.vehicle_type = kFixedWingType,
                          .is_autopilot = true,
                          .autopilot = type_,
                          .armed = true,
                          .custom_mode = type_ == AutopilotType::px4 ? kPx4Mission : kPlaneAuto,
                          .state = SystemState::active});
  }
  for (auto& [kind, stream] : streams_) {
    if (now_s < stream.next_s) continue;
    stream.next_s = std::max(stream.next_s + stream.period_s, now_s - stream.period_s);
    if (const auto message = message_of(kind)) send(link_, *message);
  }
  if (truth && now_s >= next_truth_s_) {
    next_truth_s_ = now_s + kTruthPeriod_s;
    send(truth_, *message_of(StreamedMessage::system_time));
    send(truth_, *message_of(StreamedMessage::sim_state));
  }
}

void LoopAutopilot::receive() {
  const std::int64_t now_us = std::llround(aircraft_.now_s() * 1e6);
  truth_.transport->advance(now_us, [&](const Transport::Arrival&) { truth_.transport->follow_sender(now_us); });
  link_.transport->advance(now_us, [&](const Transport::Arrival& arrival) {
    if (!link_.transport->follow_sender(now_us)) return;  // nadird is there, and this is somebody else
    link_.reader.add(arrival.bytes);
    if (arrival.whole) link_.reader.finish();
    while (const auto frame = link_.reader.next()) take(*frame);
  });
}

void LoopAutopilot::take(const MavlinkFrame& frame) {
  if (const auto message = decode(frame)) {
    if (const auto* text = std::get_if<StatusText>(&*message)) texts_.push_back(text->text);
  }
  const CompanionMessage message = decode_from_companion(frame);
  if (const auto* gps = std::get_if<GpsInput>(&message); gps != nullptr && type_ == AutopilotType::ardupilot) {
    if (gps->gps_id != 0 || gps->fix < GpsFix::three_d) return;
    take_given_position(gps->place, gps->horizontal_accuracy_m.value_or(1), gps->velocity,
                        gps->speed_accuracy_mps.value_or(1));
  } else if (const auto* position = std::get_if<GlobalPositionSensor>(&message);
             position != nullptr && type_ == AutopilotType::px4) {
    take_given_position(position->place, position->sigma_m, std::nullopt, 0);
  } else if (const auto* command = std::get_if<CommandLong>(&message)) {
    obey(*command, frame.source);
  } else if (const auto* request = std::get_if<ParameterRequest>(&message)) {
    answer_parameter(request->name);
  } else if (const auto* set = std::get_if<ParameterSet>(&message); set != nullptr && set->name == kGpsControl) {
    if (type_ == AutopilotType::px4 && set->type == kInt32Parameter) {
      double& gps_control = parameters_[kGpsControl];
      gps_control =
          value_of(ParameterValue{.wire_value = set->wire_value, .type = set->type}, ParameterEncoding::bytewise);
      aircraft_.use_gps(gps_control != 0);
    }
    answer_parameter(set->name);
  }
}

void LoopAutopilot::take_given_position(LonLat place, double sigma_m, const std::optional<GpsVelocity>& velocity,
                                        double speed_sigma_mps) {
  GivenPosition given{.place = frame_.plane_from_lonlat(place), .sigma_m = sigma_m};
  if (velocity) given.velocity_mps = Eigen::Vector2d(velocity->east_mps, velocity->north_mps);
  given.velocity_sigma_mps = speed_sigma_mps;
  aircraft_.receive(given);
  given_.push_back(given);
}

void LoopAutopilot::obey(const CommandLong& command, MavlinkAddress sender) {
  CommandResult result = CommandResult::unsupported;
  if (const auto request = stream_request(command)) {
    result = CommandResult::denied;
    if (request->message_id == message_id(StreamedMessage::autopilot_version) && !request->period_s) {
      send(link_, *message_of(StreamedMessage::autopilot_version));
      result = CommandResult::accepted;
    }
    for (auto& [kind, stream] : streams_) {
      if (message_id(kind) != request->message_id) continue;
      if (!request->period_s) stream.next_s = aircraft_.now_s();
      if (request->period_s)
        stream.period_s = *request->period_s == 0 ? stream.usual_s : *request->period_s < 0 ? 1e9 : *request->period_s;
      result = CommandResult::accepted;
    }
  }
  link_.transport->send(encode(CommandAck{command.command, result, sender}, kAutopilot, link_.sequence++));
}

void LoopAutopilot::answer_parameter(const std::string& name) {
  const auto known = parameters_.find(name);
  if (known == parameters_.end()) return;
  const std::uint8_t type = name == kGpsControl ? kInt32Parameter : kFloatParameter;
  send(link_, ParameterValue{.name = name,
                             .wire_value = wire_value(known->second, type, parameter_encoding(type_)),
                             .type = type,
                             .count = static_cast<int>(parameters_.size()),
                             .index = static_cast<int>(std::distance(parameters_.begin(), known))});
}

void LoopAutopilot::send(End& end, const IncomingMessage& message) {
  if (const auto bytes = encode_from_autopilot(type_, message, kAutopilot, end.sequence++)) end.transport->send(*bytes);
}

std::optional<IncomingMessage> LoopAutopilot::message_of(StreamedMessage kind) {
  const FixedWing& body = aircraft_.body();
  const auto boot_ms = static_cast<std::uint32_t>((aircraft_.now_s() + kBootedBefore_s) * 1000);
  const Attitude attitude = aircraft_.estimated_attitude();
  switch (kind) {
    case StreamedMessage::system_time: return SystemTime{unix_us_, boot_ms};
    case StreamedMessage::attitude:
      return AircraftAttitude{boot_ms, attitude.roll_rad, attitude.pitch_rad, attitude.heading_rad,
                              vector3(body.rates_rad_s())};
    case StreamedMessage::global_position: {
      const PositionFilter& filter = aircraft_.filter();
      return GlobalPosition{.boot_ms = boot_ms,
                            .place = frame_.lonlat_from_plane(filter.place()),
                            .msl_m = aircraft_.estimated_altitude_m(),
                            .above_home_m = aircraft_.estimated_altitude_m() - home_altitude_m_,
                            .velocity = {filter.velocity_mps().y(), filter.velocity_mps().x(), 0},
                            .heading_rad = attitude.heading_rad};
    }
    case StreamedMessage::gps_raw:
    case StreamedMessage::gps2_raw: {
      GpsRaw raw{
          .receiver = kind == StreamedMessage::gps_raw ? 1 : 2, .time_us = boot_ms * 1000ULL, .fix = GpsFix::none};
      if (const auto& own = aircraft_.own_gps()) {
        raw.fix = GpsFix::three_d;
        raw.place = frame_.lonlat_from_plane(own->place);
        raw.msl_m = body.altitude_m();
        raw.hdop = 0.8;
        raw.ground_speed_mps = own->velocity_mps.norm();
        raw.course_rad = std::atan2(own->velocity_mps.x(), own->velocity_mps.y());
        raw.satellites = 14;
        raw.horizontal_accuracy_m = kGpsAccuracy_m;
        raw.vertical_accuracy_m = kGpsVerticalAccuracy_m;
        raw.speed_accuracy_mps = kGpsSpeedAccuracy_mps;
      }
      return raw;
    }
    case StreamedMessage::raw_imu:
    case StreamedMessage::highres_imu: {
      const FixedWing::Inertial mean = aircraft_.take_inertial();
      return ImuSample{1, boot_ms * 1000ULL, vector3(mean.force_mps2), vector3(mean.rate_rad_s)};
    }
    case StreamedMessage::ekf_status:
      return EkfStatus{.attitude = true,
                       .horizontal_velocity = true,
                       .horizontal_position_relative = true,
                       .horizontal_position_absolute = aircraft_.filter().sigma_m() < 25,
                       .vertical_position = true,
                       .gps_glitching = aircraft_.gps_rejected()};
    case StreamedMessage::estimator_status:
      return EstimatorStatus{.horizontal_position_absolute = aircraft_.filter().sigma_m() < 25,
                             .gps_glitching = aircraft_.gps_rejected(),
                             .horizontal_position_ratio = aircraft_.gps_rejected() ? 2.0 : 0.2,
                             .horizontal_accuracy_m = aircraft_.filter().sigma_m()};
    case StreamedMessage::autopilot_version: {
      AutopilotVersion version{};
      version.flight_software = type_ == AutopilotType::px4 ? kPx4GlobalPosition | 255U : 0x040601FFU;
      version.uid = 1;
      return version;
    }
    case StreamedMessage::sim_state: {
      const Attitude& t = body.attitude();
      return SimState{.roll_rad = t.roll_rad,
                      .pitch_rad = t.pitch_rad,
                      .yaw_rad = t.heading_rad,
                      .rate_rad_s = vector3(body.rates_rad_s()),
                      .place = frame_.lonlat_from_plane(body.place()),
                      .msl_m = body.altitude_m(),
                      .velocity = {body.velocity_mps().y(), body.velocity_mps().x(), 0}};
    }
    default: return std::nullopt;
  }
}

}  // namespace nadir
