#include "provision/autopilot_session.hpp"

#include <fmt/format.h>
#include <poll.h>

#include <algorithm>
#include <chrono>
#include <system_error>
#include <utility>

#include "base/error.hpp"
#include "cli/terminal.hpp"

namespace nadir {
namespace {

constexpr MavlinkAddress kOwn{.system = 1, .component = 191};  // MAV_COMP_ID_ONBOARD_COMPUTER
constexpr std::uint8_t kLinkId = 2;  // the service has 1: its signing times are another stream
constexpr std::int64_t kSecond_us = 1'000'000;
constexpr std::int64_t kRepeat_us = kSecond_us / 2;

template <class Clock>
std::int64_t us_of() {
  return std::chrono::duration_cast<std::chrono::microseconds>(Clock::now().time_since_epoch()).count();
}

std::int64_t steady_us() { return us_of<std::chrono::steady_clock>(); }

}  // namespace

AutopilotSession::AutopilotSession(std::string url, double timeout_s) : url_(std::move(url)), timeout_s_(timeout_s) {
  parse_endpoint(url_);
}

AutopilotSession::~AutopilotSession() { forget_signing_time(); }

void AutopilotSession::forget_signing_time() {
  signing_time_.reset();
  std::error_code ignored;  // then the next session begins where it ends
  if (!time_file_.empty()) std::filesystem::remove(time_file_, ignored);
}

void AutopilotSession::open() { open_with(std::nullopt); }

void AutopilotSession::open_signed(const SigningKey& key, const std::filesystem::path& time_file) {
  link_.reset();
  time_file_ = time_file;
  forget_signing_time();
  signing_time_ = std::make_unique<SigningTime>(time_file, us_of<std::chrono::system_clock>(), steady_us());
  open_with(Signing(key, *signing_time_, kLinkId));
}

void AutopilotSession::open_with(std::optional<Signing> signing) {
  link_.reset();  // first: it may hold the port
  const Endpoint endpoint = parse_endpoint(url_);
  link_ = std::make_unique<MavlinkLink>(make_transport(endpoint), kOwn, std::move(signing));
  next_heartbeat_us_ = 0;
  link_->advance(steady_us(), [](const ReceivedMessage&) {});
  if (endpoint.kind == Endpoint::Kind::udp_listen && !link_->transport().is_open()) {
    throw Error({.what = "cannot listen for the autopilot",
                 .where = url_,
                 .expected = "an address of this machine with a free port",
                 .found = link_->transport().last_error(),
                 .fix = "stop the program that uses it (nadird?), or choose another port"});
  }
}

bool AutopilotSession::request(const std::optional<OutgoingMessage>& message, const OnMessage& on_message,
                               const std::function<bool()>& ended) {
  const std::int64_t until_us = steady_us() + static_cast<std::int64_t>(timeout_s_ * 1e6);
  std::int64_t next_request_us = 0;
  for (;;) {
    if (!ignore_interrupts_) throw_if_interrupted();
    const std::int64_t now_us = steady_us();
    bool answered = false;
    link_->advance(now_us, [&](const ReceivedMessage& received) { answered = answered || on_message(received); });
    if (answered) return true;
    if (now_us >= until_us || ended()) return false;
    if (now_us >= next_heartbeat_us_) {
      next_heartbeat_us_ = now_us + kSecond_us;
      link_->send(OwnHeartbeat{.state = SystemState::standby}, now_us);
    }
    if (message && now_us >= next_request_us) {
      next_request_us = now_us + kRepeat_us;
      link_->send(*message, now_us);
    }
    pollfd waiting{.fd = link_->transport().descriptor(), .events = link_->transport().events(), .revents = 0};
    ::poll(&waiting, 1, 50);
  }
}

void AutopilotSession::send(const OutgoingMessage& message) { link_->send(message, steady_us()); }

namespace {

// Radios inject unsigned frames of their own into a signed link: one or two a second.
constexpr std::uint64_t kUnsignedFrames = 50;

constexpr int kKeyTries = 3;

bool is_heartbeat(const ReceivedMessage& message) {
  const auto* heartbeat = std::get_if<Heartbeat>(&message.message);
  return heartbeat != nullptr && heartbeat->is_autopilot;
}

std::string frames_received(const AutopilotSession& session) {
  const SignatureCounts counts = session.counts().signatures;
  return fmt::format("in {} s: {} unsigned frames, {} signed with another key, {} with an old time",
                     session.timeout_s(), counts.without, counts.wrong, counts.too_old + counts.replayed);
}

}  // namespace

LinkState open_detected(AutopilotSession& session, const std::optional<SigningKey>& key,
                        const std::filesystem::path& time_file) {
  if (!key) {
    session.open();
    return LinkState::unsigned_link;
  }
  session.open_signed(*key, time_file);
  const auto not_signed_by_us = [&] {
    const SignatureCounts counts = session.counts().signatures;
    return counts.without >= kUnsignedFrames || counts.wrong >= kUnsignedFrames;
  };
  if (session.request({}, is_heartbeat, not_signed_by_us)) return LinkState::signed_with_key;
  if (session.counts().signatures.wrong > 0) {
    throw Error({.what = "the autopilot signs with another key",
                 .where = session.url(),
                 .expected = "no key yet, or the one of --signing-key",
                 .found = frames_received(session),
                 .fix = "give the key that it has, or remove that key first (over USB, with the ground station)"});
  }
  session.open();
  return LinkState::unsigned_link;
}

void install_key(AutopilotSession& session, MavlinkAddress autopilot, const SigningKey& key,
                 const std::filesystem::path& time_file) {
  // Nobody acknowledges SETUP_SIGNING, and an autopilot that has just been restarted may miss it.
  for (int tries = kKeyTries;; session.open(), session.request({}, is_heartbeat)) {
    session.send(SigningSetup{autopilot, key.bytes(), signing_time_of(unix_us())});
    session.open_signed(key, time_file);
    const bool last = --tries == 0;
    const auto still_unsigned = [&] { return !last && session.counts().signatures.without >= kUnsignedFrames; };
    if (session.request({}, is_heartbeat, still_unsigned)) return;
    if (last) break;
  }
  throw Error({.what = "the autopilot does not sign with the new key",
               .where = session.url(),
               .expected = "frames signed with the key of --signing-key",
               .found = frames_received(session),
               .fix = "check its messages: it accepts no key while it is armed"});
}

bool remove_key(AutopilotSession& session, MavlinkAddress autopilot) {
  const std::uint64_t before = session.counts().signatures.without;
  // A key of zeros at time zero removes the key; at any other time ArduPilot would sign with zeros. Unsigned frames are
  // never delivered, so check the counts.
  session.send(SigningSetup{autopilot, {}, 0});
  const auto unsigned_again = [&] { return session.counts().signatures.without >= before + kUnsignedFrames; };
  session.request(
      {}, [](const ReceivedMessage&) { return false; }, unsigned_again);
  return session.counts().signatures.without > before;
}

std::int64_t unix_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

}  // namespace nadir
