#include "provision/autopilot_provisioning.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <limits>
#include <ranges>

#include "base/error.hpp"
#include "base/plural.hpp"
#include "mavlink/commands.hpp"
#include "mavlink/gps_input.hpp"
#include "mavlink/parameters.hpp"

namespace nadir {
namespace {

std::string uid_of(const AutopilotVersion& version) {
  if (std::ranges::all_of(version.uid2, [](std::uint8_t byte) { return byte == 0; })) {
    return version.uid == 0 ? std::string() : fmt::format("{:016x}", version.uid);
  }
  std::string text;
  for (const std::uint8_t byte : version.uid2) text += fmt::format("{:02x}", byte);
  return text;
}

void check(const AutopilotSession& session, const Heartbeat& heartbeat) {
  if (heartbeat.autopilot != AutopilotType::ardupilot && heartbeat.autopilot != AutopilotType::px4) {
    throw Error({.what = "this autopilot is not supported",
                 .where = session.url(),
                 .expected = "ArduPilot or PX4",
                 .found = fmt::format("MAV_AUTOPILOT {}", heartbeat.autopilot_number)});
  }
  if (heartbeat.armed) {
    throw Error({.what = "the aircraft is armed",
                 .where = session.url(),
                 .expected = "an aircraft that is disarmed, on the ground",
                 .found = "armed",
                 .fix = "disarm it; an autopilot accepts no key while it is armed"});
  }
}

}  // namespace

AutopilotIdentity identify(AutopilotSession& session) {
  AutopilotIdentity identity;
  std::optional<Heartbeat> received;
  session.request({}, [&](const ReceivedMessage& message) {
    const auto* heartbeat = std::get_if<Heartbeat>(&message.message);
    if (heartbeat == nullptr || !heartbeat->is_autopilot) return false;
    received = *heartbeat;
    identity.address = message.source;
    return true;
  });
  if (const auto closed = session.closed(); !received && closed) {
    throw Error({.what = "cannot connect to the autopilot",
                 .where = session.url(),
                 .expected = "a port that can be opened",
                 .found = closed->reason,
                 .fix = closed->fix});
  }
  if (!received) {
    throw Error({.what = "no autopilot answers",
                 .where = session.url(),
                 .expected = "its HEARTBEAT",
                 .found = fmt::format("none in {} s; {} valid frames of others, {} with a wrong checksum",
                                      session.timeout_s(), session.counts().messages, session.counts().frames.bad_crc),
                 .fix = "check power, cable, address and baud rate; a signed link needs --signing-key"});
  }
  check(session, *received);
  identity.type = received->autopilot;
  const bool known = session.request(
      request_message(identity.address, StreamedMessage::autopilot_version), [&](const ReceivedMessage& message) {
        const auto* version = std::get_if<AutopilotVersion>(&message.message);
        if (version == nullptr || message.source != identity.address) return false;
        const std::uint32_t v = version->flight_software;
        identity.software = v;
        identity.version = fmt::format("{}.{}.{}", v >> 24, (v >> 16) & 0xFF, (v >> 8) & 0xFF);
        identity.uid = uid_of(*version);
        return true;
      });
  if (!known || identity.uid.empty()) {
    throw Error({.what = "the autopilot does not identify itself",
                 .where = session.url(),
                 .expected = "AUTOPILOT_VERSION with the processor's identity",
                 .found = known ? "an identity of zeros" : fmt::format("no answer in {} s", session.timeout_s()),
                 .fix = "give its --signing-key if it has one, else update it: ArduPilot identifies itself since "
                        "version 4.0, PX4 since 1.11"});
  }
  return identity;
}

namespace {

constexpr double kMavlinkGps = 14;
constexpr double kGpsDelay_ms = 10;  // our fixes are current; 0 would mean 200 to ArduPilot

bool takes_global_position(const AutopilotIdentity& autopilot) {
  return autopilot.type == AutopilotType::px4 && autopilot.software >= kPx4GlobalPosition;
}

constexpr int kFirstSlotBit = 4;  // of EKF2_SENS_EN

// PX4's sources: src/modules/ekf2/params_aux_global_position.yaml and params_external_vision.yaml. The gate is 5 sigmas
// as that of ArduPilot; the height comes from the barometer, as a camera does not measure it; no delay is assumed, as
// our position is propagated to the moment of its sending. EKF2_GPS_CTRL is the operator's, and only watched.
// EKF2_SENS_EN (module.yaml, since the release of 1.18) switches sources off whatever their own parameters say.
std::vector<AutopilotParameter> wanted_of_px4(const AutopilotIdentity& autopilot, int receiver) {
  std::vector<AutopilotParameter> wanted;
  if (takes_global_position(autopilot)) {
    const auto slot = [&](std::string_view what) { return fmt::format("EKF2_AGP{}_{}", receiver - 1, what); };
    wanted = {{.name = slot("ID"), .wanted = static_cast<double>(receiver)},
              {.name = slot("CTRL"), .wanted = 1},
              {.name = slot("MODE"), .wanted = 0},
              {.name = slot("DELAY"), .wanted = 0},
              {.name = slot("GATE"), .wanted = 5},
              {.name = "EKF2_SENS_EN", .bits = 1 << (kFirstSlotBit + receiver - 1)}};
  } else {
    wanted = {{.name = "EKF2_EV_CTRL", .wanted = 1},
              {.name = "EKF2_EV_NOISE_MD", .wanted = 0},
              {.name = "EKF2_EV_QMIN", .wanted = 0},
              {.name = "EKF2_EV_DELAY", .wanted = 0},
              {.name = "EKF2_EVP_GATE", .wanted = 5}};
  }
  wanted.push_back({.name = "EKF2_HGT_REF", .wanted = 0});
  wanted.push_back({.name = "EKF2_GPS_CTRL", .kept = true});
  return wanted;
}

}  // namespace

std::vector<AutopilotParameter> wanted_parameters(const AutopilotIdentity& autopilot, int receiver) {
  if (autopilot.type == AutopilotType::px4) return wanted_of_px4(autopilot, receiver);
  return {{.name = fmt::format("GPS{}_TYPE", receiver), .wanted = kMavlinkGps},
          {.name = fmt::format("GPS{}_DELAY_MS", receiver), .wanted = kGpsDelay_ms},
          {.name = "EK3_SRC1_POSXY", .wanted = 3},
          {.name = "EK3_SRC1_VELXY", .wanted = 3},
          {.name = "EK3_SRC1_POSZ", .wanted = 1},
          {.name = "EK3_SRC1_YAW", .wanted = 1}};
}

namespace {

struct ReadParameter {
  double value = 0;
  std::uint8_t type = 0;
};

// A parameter that not every version has: a link that just answered others answers this within a dozen requests.
constexpr std::chrono::seconds kOptionalPatience(6);

std::optional<ReadParameter> ask(
    AutopilotSession& session, const AutopilotIdentity& autopilot, const std::string& name,
    const OutgoingMessage& request, std::optional<double> until,
    const std::function<bool()>& ended = [] { return false; }) {
  std::optional<ReadParameter> answer;
  session.request(
      request,
      [&](const ReceivedMessage& message) {
        const auto* value = std::get_if<ParameterValue>(&message.message);
        if (value == nullptr || message.source != autopilot.address || value->name != name) return false;
        answer = {value_of(*value, parameter_encoding(autopilot.type)), value->type};
        return !until || answer->value == *until;
      },
      ended);
  return answer;
}

std::optional<ReadParameter> read(AutopilotSession& session, const AutopilotIdentity& autopilot,
                                  const std::string& name) {
  return ask(session, autopilot, name, ParameterRequest{autopilot.address, name}, {});
}

std::optional<ReadParameter> read_if_present(AutopilotSession& session, const AutopilotIdentity& autopilot,
                                             const std::string& name) {
  const auto until = std::chrono::steady_clock::now() + kOptionalPatience;
  return ask(session, autopilot, name, ParameterRequest{autopilot.address, name}, {},
             [until] { return std::chrono::steady_clock::now() >= until; });
}

// The value that the autopilot reports when it is asked again.
std::optional<ReadParameter> set(AutopilotSession& session, const AutopilotIdentity& autopilot,
                                 const AutopilotParameter& one, double value) {
  const float wire = wire_value(value, one.type, parameter_encoding(autopilot.type));
  const auto answer =
      ask(session, autopilot, one.name, ParameterSet{autopilot.address, one.name, wire, one.type}, value);
  return answer && answer->value == value ? read(session, autopilot, one.name) : answer;
}

}  // namespace

namespace {

// What an autopilot reports may be any number. Nothing is set on top of one that is no mask: it would switch off the
// rest.
std::int32_t mask_of(const AutopilotParameter& one) {
  using Mask = std::numeric_limits<std::int32_t>;
  if (one.present >= Mask::min() && one.present <= Mask::max()) return static_cast<std::int32_t>(one.present);
  throw Error({.what = "the autopilot reports no mask",
               .where = one.name,
               .expected = "an integer of 32 bits",
               .found = fmt::format("{}", one.present),
               .fix = "set it to its default with a ground station"});
}

}  // namespace

std::vector<AutopilotParameter> read_parameters(AutopilotSession& session, const AutopilotIdentity& autopilot,
                                                int receiver) {
  std::vector<AutopilotParameter> parameters;
  for (AutopilotParameter one : wanted_parameters(autopilot, receiver)) {
    const bool is_optional = one.bits != 0;  // a mask of sensors, which not every version has
    const auto answer =
        is_optional ? read_if_present(session, autopilot, one.name) : read(session, autopilot, one.name);
    if (!answer && is_optional) continue;
    if (!answer) {
      throw Error(
          {.what = "the autopilot does not report a parameter",
           .where = one.name,
           .expected = "its value",
           .found = fmt::format("no answer in {} s", session.timeout_s()),
           .fix = autopilot.type == AutopilotType::px4
                      ? "the firmware must contain EKF2 with auxiliary global position (from 1.18 on) or external "
                        "vision (CONFIG_EKF2_AUX_GLOBAL_POSITION, CONFIG_EKF2_EXTERNAL_VISION)"
                      : "ArduPilot 4.6 or later with EKF3 is needed; GPS2_TYPE exists when GPS2 is enabled"});
    }
    one.present = answer->value;
    one.type = answer->type;
    if (one.kept) one.wanted = one.present;
    if (one.bits != 0) one.wanted = mask_of(one) | one.bits;
    parameters.push_back(std::move(one));
  }
  return parameters;
}

void set_parameters(AutopilotSession& session, const AutopilotIdentity& autopilot,
                    const std::vector<AutopilotParameter>& parameters, std::vector<AutopilotParameter>& changed) {
  for (const AutopilotParameter& one : parameters) {
    if (!one.differs()) continue;
    changed.push_back(one);  // first: the answer may be lost, but not the request
    const auto answer = set(session, autopilot, one, one.wanted);
    if (answer && answer->value == one.wanted) continue;
    throw Error(
        {.what = "the autopilot does not accept a parameter",
         .where = one.name,
         .expected = fmt::format("{}", one.wanted),
         .found = answer ? fmt::format("{}", answer->value) : "no answer",
         .fix = "look for the reason in the autopilot's messages (read-only parameters, a locked ground station)"});
  }
}

std::vector<std::string> restore_parameters(AutopilotSession& session, const AutopilotIdentity& autopilot,
                                            const std::vector<AutopilotParameter>& changed) {
  std::vector<std::string> failed;
  for (const AutopilotParameter& one : std::views::reverse(changed)) {
    const auto answer = set(session, autopilot, one, one.present);
    if (!answer || answer->value != one.present) failed.push_back(one.name);
  }
  return failed;
}

namespace {

constexpr int kImuSamples = 50;
constexpr std::uint64_t kMaxMeasurement_us = 3'000'000;  // by the autopilot's clock
constexpr double kSettling_s = 10;                       // ArduPlane 4.7 accepts no rate for 14 s after its start
constexpr LonLat kNowhere{-11.2345678, 2.3456789};       // the Gulf of Guinea
constexpr double kNowhereSigma_m = 100;                  // arming and the filter require 5
constexpr double kSamePlace_deg = 1e-6;

StreamedMessage imu_stream(const AutopilotIdentity& autopilot) {
  return autopilot.type == AutopilotType::px4 ? StreamedMessage::highres_imu : StreamedMessage::raw_imu;
}

// By the autopilot's clock; 0 when none came.
double imu_rate_hz(AutopilotSession& session, const AutopilotIdentity& autopilot) {
  std::optional<std::uint64_t> first_us;
  std::uint64_t last_us = 0;
  int samples = 0;
  const auto count = [&](const ReceivedMessage& message) {
    const auto* imu = std::get_if<ImuSample>(&message.message);
    if (imu == nullptr || message.source != autopilot.address || imu->instance != 1 || imu->time_us <= last_us)
      return false;
    last_us = imu->time_us;
    if (!first_us) first_us = last_us;
    return ++samples > kImuSamples || last_us - *first_us > kMaxMeasurement_us;
  };
  session.request(set_message_interval(autopilot.address, imu_stream(autopilot), kWantedImuRate_hz), count);
  return samples < 2 ? 0 : (samples - 1) * 1e6 / static_cast<double>(last_us - *first_us);
}

}  // namespace

std::string_view imu_name(const AutopilotIdentity& autopilot) {
  return autopilot.type == AutopilotType::px4 ? "HIGHRES_IMU" : "RAW_IMU";
}

double check_imu_rate(AutopilotSession& session, const AutopilotIdentity& autopilot) {
  const auto until =
      std::chrono::steady_clock::now() + std::chrono::duration<double>(kSettling_s + session.timeout_s());
  double rate_hz = 0;
  do {
    rate_hz = imu_rate_hz(session, autopilot);
    if (rate_hz >= kMinImuRate_hz) return rate_hz;
  } while (rate_hz > 0 && std::chrono::steady_clock::now() < until);
  throw Error({.what = "the rate of the accelerometer is too low",
               .where = session.url(),
               .expected = fmt::format("{} at {} Hz, as asked for; at least {}", imu_name(autopilot), kWantedImuRate_hz,
                                       kMinImuRate_hz),
               .found = rate_hz > 0 ? fmt::format("{:.1f} Hz by the autopilot's clock", rate_hz) : "none",
               .fix = autopilot.type == AutopilotType::px4
                          ? "raise the link's baud rate (SER_…_BAUD), and set MAV_n_MODE 2 (Onboard) and MAV_n_RATE 0"
                          : "raise the link's baud rate, and lower the SRn_ rates of other streams on it"});
}

void check_gps_input(AutopilotSession& session, MavlinkAddress autopilot, int receiver) {
  const auto gps_id = static_cast<std::uint8_t>(receiver - 1);
  std::optional<GpsRaw> last;
  const Fix fix{.unix_us = unix_us(), .place = kNowhere, .sigma_m = kNowhereSigma_m};
  const bool received = session.request(gps_input(fix, gps_id), [&](const ReceivedMessage& message) {
    const auto* gps = std::get_if<GpsRaw>(&message.message);
    if (gps == nullptr || message.source != autopilot || gps->receiver != receiver) return false;
    last = *gps;
    return std::abs(gps->place.lat_deg - kNowhere.lat_deg) < kSamePlace_deg &&
           std::abs(gps->place.lon_deg - kNowhere.lon_deg) < kSamePlace_deg;
  });
  session.send(gps_input_without_fix(unix_us(), gps_id));
  if (received) return;
  throw Error({.what = "the autopilot does not receive GPS_INPUT",
               .where = session.url(),
               .expected = fmt::format("its receiver {} at {:.7f}, {:.7f}, as sent", receiver, kNowhere.lon_deg,
                                       kNowhere.lat_deg),
               .found = last ? fmt::format("{:.7f}, {:.7f}", last->place.lon_deg, last->place.lat_deg)
                             : fmt::format("no message from that receiver in {} s", session.timeout_s()),
               .fix = "restart the autopilot, which reads the receivers' types at its start, and provision again"});
}

void check_estimator(AutopilotSession& session, MavlinkAddress autopilot) {
  const bool reported = session.request(
      set_message_interval(autopilot, StreamedMessage::estimator_status, 4), [&](const ReceivedMessage& message) {
        return message.source == autopilot && std::holds_alternative<EstimatorStatus>(message.message);
      });
  if (reported) return;
  throw Error({.what = "PX4's position filter does not report",
               .where = session.url(),
               .expected = "ESTIMATOR_STATUS",
               .found = fmt::format("none in {} s", session.timeout_s()),
               .fix = "look at its messages: EKF2 must run (EKF2_EN 1, sensors calibrated)"});
}

namespace {

std::optional<std::uint32_t> boot_ms(AutopilotSession& session, MavlinkAddress autopilot,
                                     std::optional<std::uint32_t> before) {
  std::optional<std::uint32_t> answer;
  session.request(request_message(autopilot, StreamedMessage::system_time), [&](const ReceivedMessage& message) {
    const auto* time = std::get_if<SystemTime>(&message.message);
    if (time == nullptr || message.source != autopilot || (before && time->boot_ms >= *before)) return false;
    answer = time->boot_ms;
    return true;
  });
  return answer;
}

// Whether the autopilot reads this parameter only at its start. PX4 does so with the delays and the references; it
// restarts in seconds.
bool needs_restart(const AutopilotParameter& parameter) {
  if (parameter.name.starts_with("EKF2_")) return true;
  return parameter.name.ends_with("_TYPE") || parameter.name.ends_with("_DELAY_MS");
}

struct Changes {
  std::vector<AutopilotParameter> parameters;
  bool key = false;
};

// What could not be reverted; empty when all is as before.
std::string revert(AutopilotSession& session, const AutopilotIdentity& autopilot, const Changes& changes) {
  session.ignore_interrupts();
  const SignatureCounts received = session.counts().signatures;
  const bool signs = changes.key && received.accepted > 0;
  std::string left;
  try {
    if (changes.key && !signs) session.open();  // as the autopilot continues
  } catch (const Error& error) {
    left = error.text().what + "; ";
  }
  const auto failed = restore_parameters(session, autopilot, changes.parameters);
  if (!failed.empty()) left += fmt::format("not reverted: {}; ", fmt::join(failed, ", "));
  const bool without_key = signs ? remove_key(session, autopilot.address) : !changes.key || received.without > 0;
  if (!without_key) left += "it may still have the signing key: keep that key file; ";
  return left;
}

}  // namespace

void restart(AutopilotSession& session, MavlinkAddress autopilot) {
  const auto before = boot_ms(session, autopilot, {});
  if (before) {
    session.send(restart_command(autopilot));
    if (boot_ms(session, autopilot, before)) return;
  }
  throw Error({.what = "the autopilot does not restart",
               .where = session.url(),
               .expected = "a SYSTEM_TIME that counts from a new start",
               .found = before ? fmt::format("none in {} s", session.timeout_s()) : "no SYSTEM_TIME",
               .fix = "allow more time with --timeout-s"});
}

Provisioned provision(AutopilotSession& session, const AutopilotIdentity& autopilot, LinkState link,
                      const std::vector<AutopilotParameter>& parameters, const ProvisioningOptions& options,
                      const std::function<void()>& last, const std::function<void(std::string_view)>& on_step) {
  Provisioned result;
  Changes changes;
  const bool px4 = autopilot.type == AutopilotType::px4;
  if (options.key && px4 && !takes_global_position(autopilot)) {
    throw Error({.what = "this version of PX4 cannot sign its link",
                 .where = session.url(),
                 .expected = "PX4 1.18 or later with --signing-key",
                 .found = "PX4 " + autopilot.version,
                 .fix = "update it, or leave --signing-key away; nadird then needs --unsigned-link"});
  }
  try {
    set_parameters(session, autopilot, parameters, changes.parameters);
    on_step(count(changes.parameters.size(), "parameter") + " set");
    if (std::ranges::any_of(changes.parameters, needs_restart)) {
      restart(session, autopilot.address);
      result.restarted = true;
      on_step("restarted");
    }
    if (options.key && link == LinkState::unsigned_link) {
      changes.key = true;
      install_key(session, autopilot.address, *options.key, options.signing_time);
      result.key_installed = true;
      on_step("the link is signed");
    }
    result.imu_rate_hz = check_imu_rate(session, autopilot);
    if (px4) {
      check_estimator(session, autopilot.address);
      on_step("HIGHRES_IMU and ESTIMATOR_STATUS work");
    } else {
      check_gps_input(session, autopilot.address, options.receiver);
      on_step("RAW_IMU and GPS_INPUT work");
    }
    last();
  } catch (const Error& error) {
    ErrorText text = error.text();
    const std::string left = revert(session, autopilot, changes);
    text.fix = (left.empty() ? "all changes to the autopilot were reverted; " : left) + text.fix;
    throw Error(text);
  } catch (const Interrupted&) {
    revert(session, autopilot, changes);
    throw;
  }
  return result;
}

}  // namespace nadir
