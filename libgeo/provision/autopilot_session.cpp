#include "provision/autopilot_session.hpp"

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
constexpr std::int64_t kAskAgain_us = kSecond_us / 2;

template <class Clock>
std::int64_t us_of() {
  return std::chrono::duration_cast<std::chrono::microseconds>(Clock::now().time_since_epoch()).count();
}

std::int64_t steady_us() { return us_of<std::chrono::steady_clock>(); }

}  // namespace

AutopilotSession::AutopilotSession(std::string url, double patience_s) : url_(std::move(url)), patience_s_(patience_s) {
  parse_endpoint(url_);
}

AutopilotSession::~AutopilotSession() { forget_signing_time(); }

void AutopilotSession::forget_signing_time() {
  signing_time_.reset();
  std::error_code ignored;  // then the next one begins where it ends
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
    throw Error({.what = "the autopilot cannot be listened for",
                 .where = url_,
                 .expected = "an address of this machine with a free port",
                 .found = link_->transport().last_error(),
                 .fix = "end the program that uses it (nadird?), or choose another port"});
  }
}

bool AutopilotSession::ask(const std::optional<OutgoingMessage>& request, const Hear& hear,
                           const std::function<bool()>& ended) {
  const std::int64_t until_us = steady_us() + static_cast<std::int64_t>(patience_s_ * 1e6);
  std::int64_t next_request_us = 0;
  for (;;) {
    if (heed_interrupts_) throw_if_interrupted();
    const std::int64_t now_us = steady_us();
    bool answered = false;
    link_->advance(now_us, [&](const ReceivedMessage& message) { answered = answered || hear(message); });
    if (answered) return true;
    if (now_us >= until_us || ended()) return false;
    if (now_us >= next_heartbeat_us_) {
      next_heartbeat_us_ = now_us + kSecond_us;
      link_->send(OwnHeartbeat{.state = SystemState::standby}, now_us);
    }
    if (request && now_us >= next_request_us) {
      next_request_us = now_us + kAskAgain_us;
      link_->send(*request, now_us);
    }
    pollfd waiting{.fd = link_->transport().descriptor(), .events = link_->transport().events(), .revents = 0};
    ::poll(&waiting, 1, 50);
  }
}

void AutopilotSession::send(const OutgoingMessage& message) { link_->send(message, steady_us()); }

}  // namespace nadir
