#include "provision/provisioning.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "base/error.hpp"
#include "mavlink/commands.hpp"
#include "provision/smoke_test.hpp"

namespace nadir {
namespace {

std::optional<std::uint32_t> boot_ms(AutopilotSession& session, MavlinkAddress autopilot,
                                     std::optional<std::uint32_t> before) {
  std::optional<std::uint32_t> told;
  session.ask(request_message(autopilot, StreamedMessage::system_time), [&](const ReceivedMessage& message) {
    const auto* time = std::get_if<SystemTime>(&message.message);
    if (time == nullptr || message.source != autopilot || (before && time->boot_ms >= *before)) return false;
    told = time->boot_ms;
    return true;
  });
  return told;
}

// Whether the autopilot looks at this one at its start alone.
bool needs_restart(const AutopilotParameter& parameter) {
  return parameter.name.ends_with("_TYPE") || parameter.name.ends_with("_DELAY_MS");
}

struct Changes {
  std::vector<AutopilotParameter> parameters;
  bool key = false;
};

// What could not be put back; empty when all is as before.
std::string put_back(AutopilotSession& session, MavlinkAddress autopilot, const Changes& changes) {
  session.heed_interrupts(false);
  const SignatureCounts heard = session.counts().signatures;
  const bool signs = changes.key && heard.accepted > 0;
  std::string left;
  try {
    if (changes.key && !signs) session.open();  // as it goes on to speak
  } catch (const Error& error) {
    left = error.text().what + "; ";
  }
  const auto failed = restore_parameters(session, autopilot, changes.parameters);
  if (!failed.empty()) left += fmt::format("still changed: {}; ", fmt::join(failed, ", "));
  const bool without_key = signs ? remove_key(session, autopilot) : !changes.key || heard.without > 0;
  if (!without_key) left += "it may still have the signing key: keep that file; ";
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
               .found = before ? fmt::format("none in {} s", session.patience_s()) : "no SYSTEM_TIME",
               .fix = "give it longer with --patience-s"});
}

Provisioned provision(AutopilotSession& session, const AutopilotIdentity& autopilot, LinkState link,
                      const std::vector<AutopilotParameter>& parameters, const ProvisioningWish& wish,
                      const std::function<void()>& last, const std::function<void(std::string_view)>& told) {
  Provisioned result;
  Changes changes;
  try {
    set_parameters(session, autopilot.address, parameters, changes.parameters);
    told(fmt::format("{} parameters set", changes.parameters.size()));
    if (std::ranges::any_of(changes.parameters, needs_restart)) {
      restart(session, autopilot.address);
      result.restarted = true;
      told("restarted");
    }
    if (wish.key && link == LinkState::unsigned_link) {
      changes.key = true;
      install_key(session, autopilot.address, *wish.key, wish.signing_time);
      result.key_installed = true;
      told("the link is signed");
    }
    result.imu_rate_hz = check_imu_rate(session, autopilot.address);
    check_gps_input(session, autopilot.address, wish.receiver);
    told("RAW_IMU and GPS_INPUT work");
    last();
  } catch (const Error& error) {
    ErrorText text = error.text();
    const std::string left = put_back(session, autopilot.address, changes);
    text.fix = (left.empty() ? "the autopilot is as it was before; " : left) + text.fix;
    throw Error(text);
  } catch (const Interrupted&) {
    put_back(session, autopilot.address, changes);
    throw;
  }
  return result;
}

}  // namespace nadir
