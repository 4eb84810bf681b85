#include "provision/autopilot_parameters.hpp"

#include <fmt/format.h>

#include <ranges>

#include "base/error.hpp"

namespace nadir {
namespace {

constexpr double kMavlinkGps = 14;
constexpr double kGpsDelay_ms = 10;  // our fixes are of now; 0 would mean 200 to ArduPilot

std::vector<AutopilotParameter> wanted(int receiver) {
  return {{.name = fmt::format("GPS{}_TYPE", receiver), .wanted = kMavlinkGps},
          {.name = fmt::format("GPS{}_DELAY_MS", receiver), .wanted = kGpsDelay_ms},
          {.name = "EK3_SRC1_POSXY", .wanted = 3},
          {.name = "EK3_SRC1_VELXY", .wanted = 3},
          {.name = "EK3_SRC1_POSZ", .wanted = 1},
          {.name = "EK3_SRC1_YAW", .wanted = 1}};
}

std::optional<ParameterValue> ask(AutopilotSession& session, MavlinkAddress autopilot, const std::string& name,
                                  const OutgoingMessage& request, std::optional<double> until) {
  std::optional<ParameterValue> told;
  session.ask(request, [&](const ReceivedMessage& message) {
    const auto* value = std::get_if<ParameterValue>(&message.message);
    if (value == nullptr || message.source != autopilot || value->name != name) return false;
    told = *value;
    return !until || value->value == *until;
  });
  return told;
}

std::optional<ParameterValue> read(AutopilotSession& session, MavlinkAddress autopilot, const std::string& name) {
  return ask(session, autopilot, name, ParameterRequest{autopilot, name}, {});
}

// Whether it is so, by its own word when it is asked again.
std::optional<ParameterValue> set(AutopilotSession& session, MavlinkAddress autopilot, const AutopilotParameter& one,
                                  double value) {
  const ParameterSet request{autopilot, one.name, static_cast<float>(value), one.type};
  const auto told = ask(session, autopilot, one.name, request, value);
  return told && told->value == value ? read(session, autopilot, one.name) : told;
}

}  // namespace

std::vector<AutopilotParameter> read_parameters(AutopilotSession& session, MavlinkAddress autopilot, int receiver) {
  std::vector<AutopilotParameter> parameters = wanted(receiver);
  for (AutopilotParameter& one : parameters) {
    const auto told = read(session, autopilot, one.name);
    if (!told) {
      throw Error({.what = "the autopilot does not tell a parameter",
                   .where = one.name,
                   .expected = "its value",
                   .found = fmt::format("no answer in {} s", session.patience_s()),
                   .fix = "ArduPilot 4.6 or later with EKF3 is needed; GPS2_TYPE is there when GPS2 is enabled"});
    }
    one.present = told->value;
    one.type = told->type;
  }
  return parameters;
}

void set_parameters(AutopilotSession& session, MavlinkAddress autopilot,
                    const std::vector<AutopilotParameter>& parameters, std::vector<AutopilotParameter>& changed) {
  for (const AutopilotParameter& one : parameters) {
    if (!one.differs()) continue;
    changed.push_back(one);  // before: the answer may be lost, not the request
    const auto told = set(session, autopilot, one, one.wanted);
    if (told && told->value == one.wanted) continue;
    throw Error(
        {.what = "the autopilot does not take a parameter",
         .where = one.name,
         .expected = fmt::format("{}", one.wanted),
         .found = told ? fmt::format("{}", told->value) : "no answer",
         .fix = "look for a reason in the autopilot's messages (read-only parameters, a locked ground station)"});
  }
}

std::vector<std::string> restore_parameters(AutopilotSession& session, MavlinkAddress autopilot,
                                            const std::vector<AutopilotParameter>& changed) {
  std::vector<std::string> failed;
  for (const AutopilotParameter& one : std::views::reverse(changed)) {
    const auto told = set(session, autopilot, one, one.present);
    if (!told || told->value != one.present) failed.push_back(one.name);
  }
  return failed;
}

}  // namespace nadir
