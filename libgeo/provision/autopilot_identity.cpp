#include "provision/autopilot_identity.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "base/error.hpp"
#include "mavlink/commands.hpp"

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
  if (!heartbeat.is_ardupilot) {
    throw Error({.what = "this autopilot is not ArduPilot",
                 .where = session.url(),
                 .expected = "ArduPilot, whose parameters and GPS_INPUT this is made for",
                 .found = "another autopilot"});
  }
  if (heartbeat.armed) {
    throw Error({.what = "the aircraft is armed",
                 .where = session.url(),
                 .expected = "an aircraft that is disarmed, on the ground",
                 .found = "armed",
                 .fix = "disarm it; an autopilot takes no key while it is armed"});
  }
}

}  // namespace

AutopilotIdentity identify(AutopilotSession& session) {
  AutopilotIdentity identity;
  std::optional<Heartbeat> heard;
  session.ask({}, [&](const ReceivedMessage& message) {
    const auto* heartbeat = std::get_if<Heartbeat>(&message.message);
    if (heartbeat == nullptr || !heartbeat->is_autopilot) return false;
    heard = *heartbeat;
    identity.address = message.source;
    return true;
  });
  if (!heard) {
    throw Error({.what = "no autopilot is heard",
                 .where = session.url(),
                 .expected = "its HEARTBEAT",
                 .found = fmt::format("none in {} s; {} sound frames of others, {} with a wrong checksum",
                                      session.patience_s(), session.counts().messages, session.counts().frames.bad_crc),
                 .fix = "check power, cable, address and baud rate; a signed link needs --signing-key"});
  }
  check(session, *heard);
  const bool known = session.ask(
      request_message(identity.address, StreamedMessage::autopilot_version), [&](const ReceivedMessage& message) {
        const auto* version = std::get_if<AutopilotVersion>(&message.message);
        if (version == nullptr || message.source != identity.address) return false;
        const std::uint32_t v = version->flight_software;
        identity.version = fmt::format("{}.{}.{}", v >> 24, (v >> 16) & 0xFF, (v >> 8) & 0xFF);
        identity.uid = uid_of(*version);
        return true;
      });
  if (!known || identity.uid.empty()) {
    throw Error({.what = "the autopilot does not say who it is",
                 .where = session.url(),
                 .expected = "AUTOPILOT_VERSION with the processor's identity",
                 .found = known ? "an identity of zeros" : fmt::format("no answer in {} s", session.patience_s()),
                 .fix = "give its --signing-key, when it has one; else update it: ArduPilot tells since version 4.0"});
  }
  return identity;
}

}  // namespace nadir
