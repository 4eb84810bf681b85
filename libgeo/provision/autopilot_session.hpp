// Questions to an autopilot over its link, one at a time, each asked again until it is answered or patience ends. For
// the bench: it waits, which the service in flight never does.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "mavlink/link.hpp"

namespace nadir {

class AutopilotSession {
 public:
  using Hear = std::function<bool(const ReceivedMessage&)>;  // true: that is the answer

  // url: mavlink/endpoint.hpp. Throws UsageError for one that does not read, Error when it cannot be listened at.
  AutopilotSession(std::string url, double patience_s);
  ~AutopilotSession();

  // The link anew, signed with a key or not. Each begins at the system's clock, which has moved on by more than was
  // signed; time_file (SigningTime) is there only meanwhile.
  void open();
  void open_signed(const SigningKey& key, const std::filesystem::path& time_file);

  // Sends the request, if any, every half second until `hear` says that it was answered. False: patience ended. Throws
  // Interrupted after Ctrl-C, unless that is not to be heeded. `ended`: no need to wait any longer.
  bool ask(
      const std::optional<OutgoingMessage>& request, const Hear& hear,
      const std::function<bool()>& ended = [] { return false; });

  void send(const OutgoingMessage& message);
  LinkCounts counts() const { return link_->counts(); }
  const std::string& url() const { return url_; }
  double patience_s() const { return patience_s_; }

  // While what was changed is put back.
  void heed_interrupts(bool heed) { heed_interrupts_ = heed; }

 private:
  void forget_signing_time();
  void open_with(std::optional<Signing> signing);

  std::string url_;
  double patience_s_;
  std::filesystem::path time_file_;
  std::unique_ptr<SigningTime> signing_time_;
  std::unique_ptr<MavlinkLink> link_;
  std::int64_t next_heartbeat_us_ = 0;
  bool heed_interrupts_ = true;
};

}  // namespace nadir
