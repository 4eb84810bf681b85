// A blocking request/response session with an autopilot over its MAVLink link, for provisioning on the bench: each
// request is repeated until it is answered or times out. The service in flight never waits like this.
//
// The session also knows the key that the autopilot signs its link with: installed over an unsigned link, and verified
// by what the autopilot signs afterwards.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "mavlink/closed_link.hpp"
#include "mavlink/link.hpp"

namespace nadir {

class AutopilotSession {
 public:
  using OnMessage = std::function<bool(const ReceivedMessage&)>;  // true: that is the answer

  // url: mavlink/transport.hpp. Throws UsageError for a malformed one, Error when it cannot listen there.
  AutopilotSession(std::string url, double timeout_s);
  ~AutopilotSession();

  // Reopens the link, unsigned or signed with a key. Signing time starts at the system's clock, which has advanced by
  // more than was signed; time_file (SigningTime) exists only while the session is open.
  void open();
  void open_signed(const SigningKey& key, const std::filesystem::path& time_file);

  // Sends the request, if any, every half second until `on_message` accepts an answer. False: timed out, or `ended`
  // says that there is no point in waiting. Throws Interrupted after Ctrl-C, unless ignored.
  bool request(
      const std::optional<OutgoingMessage>& message, const OnMessage& on_message,
      const std::function<bool()>& ended = [] { return false; });

  void send(const OutgoingMessage& message);
  LinkCounts counts() const { return link_->counts(); }
  std::optional<ClosedLink> closed() const { return closed_link(link_->transport()); }  // nullopt: it is open
  const std::string& url() const { return url_; }
  double timeout_s() const { return timeout_s_; }

  // Ctrl-C is ignored while changes are reverted.
  void ignore_interrupts() { ignore_interrupts_ = true; }

 private:
  void forget_signing_time();
  void open_with(std::optional<Signing> signing);

  std::string url_;
  double timeout_s_;
  std::filesystem::path time_file_;
  std::unique_ptr<SigningTime> signing_time_;
  std::unique_ptr<MavlinkLink> link_;
  std::int64_t next_heartbeat_us_ = 0;
  bool ignore_interrupts_ = false;
};

enum class LinkState { unsigned_link, signed_with_key };

// Opens the session, signed if the autopilot signs with this key. Throws Error when it signs with another key.
LinkState open_detected(AutopilotSession& session, const std::optional<SigningKey>& key,
                        const std::filesystem::path& time_file);

// Sends the key and reopens the session signed. Throws Error when the autopilot does not sign with it.
void install_key(AutopilotSession& session, MavlinkAddress autopilot, const SigningKey& key,
                 const std::filesystem::path& time_file);

// Over the signed session. False: no unsigned frame was received afterwards.
bool remove_key(AutopilotSession& session, MavlinkAddress autopilot);

// This machine's UTC in microseconds since 1970, for signing times and new keys.
std::int64_t unix_us();

}  // namespace nadir
