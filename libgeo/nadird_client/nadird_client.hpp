// Queries a running nadird over its API, for `nadir watch` and `nadird --status`.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace nadir {

inline constexpr std::string_view kDefaultServiceUrl = "http://127.0.0.1:8750";

class NadirdClient {
 public:
  // url: "http://HOST[:PORT]". token: empty when none is required. Throws UsageError for another URL.
  explicit NadirdClient(std::string_view url, std::string token = {},
                        std::chrono::milliseconds timeout = std::chrono::seconds(5));

  // The body of a GET. Throws Error when there is no answer in time, or one with another status than 200.
  std::string get(const std::string& path) const;

  const std::string& url() const { return url_; }

 private:
  std::string url_;
  std::string host_;
  std::string port_;
  std::string token_;
  std::chrono::milliseconds timeout_;
};

struct WatchedEvent {
  std::uint64_t id = 0, count = 1;
  double age_s = 0;
  std::string severity;
  std::string text;
};

// What `nadir watch` shows of GET /v1/state. Text in it is made printable: it came over a network.
struct WatchedStatus {
  std::string boot, state, reason, source;
  double age_s = 0, state_for_s = 0;
  std::optional<double> lon_deg, lat_deg, sigma_m, anchor_age_s, heading_deg, agl_m, speed_mps, frame_age_s, link_age_s;
  std::optional<double> hpl_m;
  double alert_limit_m = 0;
  bool usable = false;
  double frames_per_s = 0;
  std::uint64_t frames_received = 0, frames_dropped = 0, anchors_accepted = 0, anchors_rejected = 0, anchors_failed = 0;
  std::uint64_t corrupt_tiles = 0;
  bool link_connected = false, link_signed = false;
  std::string link_reason;  // why it is not connected
  std::uint64_t fixes_sent = 0, link_rejected = 0;
  std::string gps, gps_reason, recorder, recorder_reason;
  std::vector<WatchedEvent> events, alarms;  // oldest first
  bool playback = false;                     // a recording, of the time `recorded` where that is known
  std::string recorded;

  bool stalled() const { return age_s > 2; }  // the flight thread is silent: nothing here is current
};

// The same, seconds later: every age and duration has grown.
WatchedStatus aged(WatchedStatus status, double seconds);

// Throws Error when the text is not a state document.
WatchedStatus parse_watched_status(std::string_view json);

}  // namespace nadir
