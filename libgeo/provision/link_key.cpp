#include "provision/link_key.hpp"

#include <fmt/format.h>

#include <chrono>

#include "base/error.hpp"

namespace nadir {
namespace {

// Radios put frames of their own, unsigned, into a signed link: one or two a second.
constexpr std::uint64_t kUnsignedFrames = 50;

bool is_heartbeat(const ReceivedMessage& message) {
  const auto* heartbeat = std::get_if<Heartbeat>(&message.message);
  return heartbeat != nullptr && heartbeat->is_autopilot;
}

std::string heard(const AutopilotSession& session) {
  const SignatureCounts counts = session.counts().signatures;
  return fmt::format("in {} s: {} unsigned frames, {} signed with another key, {} with an old time",
                     session.patience_s(), counts.without, counts.wrong, counts.too_old + counts.replayed);
}

std::int64_t unix_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

}  // namespace

LinkState open_as_it_speaks(AutopilotSession& session, const std::optional<SigningKey>& key,
                            const std::filesystem::path& time_file) {
  if (!key) {
    session.open();
    return LinkState::unsigned_link;
  }
  session.open_signed(*key, time_file);
  const auto plainly_not = [&] {
    const SignatureCounts counts = session.counts().signatures;
    return counts.without >= kUnsignedFrames || counts.wrong >= kUnsignedFrames;
  };
  if (session.ask({}, is_heartbeat, plainly_not)) return LinkState::signed_with_key;
  if (session.counts().signatures.wrong > 0) {
    throw Error(
        {.what = "the autopilot signs with another key",
         .where = session.url(),
         .expected = "no key yet, or the one of --signing-key",
         .found = heard(session),
         .fix = "give the key that it has, or take that away from it first (over USB, with the ground station)"});
  }
  session.open();
  return LinkState::unsigned_link;
}

void install_key(AutopilotSession& session, MavlinkAddress autopilot, const SigningKey& key,
                 const std::filesystem::path& time_file) {
  session.send(SigningSetup{autopilot, key.bytes(), signing_time_of(unix_us())});
  session.open_signed(key, time_file);
  if (session.ask({}, is_heartbeat)) return;
  throw Error({.what = "the autopilot does not sign with the key that it was given",
               .where = session.url(),
               .expected = "frames signed with the key of --signing-key",
               .found = heard(session),
               .fix = "look at its messages: it takes no key while it is armed"});
}

bool remove_key(AutopilotSession& session, MavlinkAddress autopilot) {
  const std::uint64_t before = session.counts().signatures.without;
  // A key of zeros at time zero is none; at any other time ArduPilot would sign with zeros. What is unsigned is never
  // handed on, so that the counts must tell.
  session.send(SigningSetup{autopilot, {}, 0});
  const auto enough = [&] { return session.counts().signatures.without >= before + kUnsignedFrames; };
  session.ask(
      {}, [](const ReceivedMessage&) { return false; }, enough);
  return session.counts().signatures.without > before;
}

}  // namespace nadir
