// Prepares an autopilot for flying with us: identify it, set the parameters that it needs (ArduPilot:
// docs/autopilot.md, PX4: docs/px4.md), install the key that its link is signed with, and test what only a try shows:
// that it sends its accelerometer often enough, and that ArduPilot receives our GPS_INPUT. A step that fails stops with
// its reason and all changes are reverted: an aircraft is provisioned or as it was before.
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "provision/autopilot_session.hpp"

namespace nadir {

struct AutopilotIdentity {
  MavlinkAddress address;
  AutopilotType type = AutopilotType::ardupilot;
  std::string uid;             // hexadecimal: of the processor, the same after every update
  std::string version;         // "4.6.1"
  std::uint32_t software = 0;  // the same, as AUTOPILOT_VERSION has it

  std::string_view name() const { return type == AutopilotType::px4 ? "PX4" : "ArduPilot"; }
};

// Throws Error when there is none, when it is neither ArduPilot nor PX4, is armed, or does not identify itself.
AutopilotIdentity identify(AutopilotSession& session);

struct AutopilotParameter {
  std::string name;
  double wanted = 0;
  double present = 0;
  std::uint8_t type = 0;
  bool kept = false;      // only watched later: wanted as it is
  std::int32_t bits = 0;  // above 0: these bits set, the others as they are; firmware without the parameter needs none

  bool differs() const { return present != wanted; }
};

// What an autopilot needs to use our position, without an autopilot to ask; `present` and `type` are 0.
// receiver: 1 or 2: for ArduPilot the GPS receiver that GPS_INPUT feeds, for PX4 the slot of the auxiliary position.
std::vector<AutopilotParameter> wanted_parameters(const AutopilotIdentity& autopilot, int receiver);

// The same with what the autopilot has. Those that are only watched are wanted as they are. Throws Error for a
// parameter without an answer; one of bits is left out then.
std::vector<AutopilotParameter> read_parameters(AutopilotSession& session, const AutopilotIdentity& autopilot,
                                                int receiver);

// Sets those that differ, and reads each back. What may have been changed is in `changed`, also when it throws.
void set_parameters(AutopilotSession& session, const AutopilotIdentity& autopilot,
                    const std::vector<AutopilotParameter>& parameters, std::vector<AutopilotParameter>& changed);

// Restores the present values, newest first. Returns the names of those that failed.
std::vector<std::string> restore_parameters(AutopilotSession& session, const AutopilotIdentity& autopilot,
                                            const std::vector<AutopilotParameter>& changed);

std::string_view imu_name(const AutopilotIdentity& autopilot);  // of the message with its accelerations

inline constexpr double kWantedImuRate_hz = 40;  // the highest rate that ArduPlane sends evenly
inline constexpr double kMinImuRate_hz = 30;

// Requests RAW_IMU (PX4: HIGHRES_IMU) and measures its rate by the autopilot's own clock, again while it is slow: an
// autopilot that has just started takes its time. Throws Error below kMinImuRate_hz.
double check_imu_rate(AutopilotSession& session, const AutopilotIdentity& autopilot);

// Sends a position where nobody flies, with an accuracy that fails every check of the autopilot, until its receiver
// reports that position, and then "no fix". Throws Error when it does not. receiver: 1 or 2, as above.
void check_gps_input(AutopilotSession& session, MavlinkAddress autopilot, int receiver);

// PX4 shows nobody what it received: the filter must run and report, ESTIMATOR_STATUS. Throws Error when it does not.
void check_estimator(AutopilotSession& session, MavlinkAddress autopilot);

struct ProvisioningOptions {
  int receiver = 1;                      // that GPS_INPUT feeds
  std::optional<SigningKey> key{};       // that the link is signed with afterwards
  std::filesystem::path signing_time{};  // file of SigningTime while provisioning; with a key
};

struct Provisioned {
  double imu_rate_hz = 0;
  bool restarted = false;
  bool key_installed = false;
};

// Restarts the autopilot and waits for it. Throws Error when it does not.
void restart(AutopilotSession& session, MavlinkAddress autopilot);

// Parameters, key, tests, then `last`: what must not happen unless all else succeeded. Throws the Error of the failed
// step; its `fix` says what could not be reverted. on_step: a line for every finished step.
Provisioned provision(AutopilotSession& session, const AutopilotIdentity& autopilot, LinkState link,
                      const std::vector<AutopilotParameter>& parameters, const ProvisioningOptions& options,
                      const std::function<void()>& last, const std::function<void(std::string_view)>& on_step);

}  // namespace nadir
