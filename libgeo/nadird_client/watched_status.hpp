// What `nadir watch` shows of GET /v1/state. Text in it is printable: it came over a network.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace nadir {

struct WatchedEvent {
  std::uint64_t id = 0;
  double age_s = 0;
  std::string severity;
  std::string text;
};

struct WatchedStatus {
  std::string boot, state, reason, source;
  double age_s = 0, state_for_s = 0;
  std::optional<double> lon_deg, lat_deg, sigma_m, anchor_age_s, heading_deg, agl_m, speed_mps;
  double frames_per_s = 0;
  std::uint64_t frames_received = 0, frames_dropped = 0, anchors_accepted = 0, anchors_rejected = 0;
  bool link_connected = false, link_signed = false;
  std::uint64_t fixes_sent = 0, link_rejected = 0;
  std::string gps, gps_reason, recorder, recorder_reason;
  std::vector<WatchedEvent> events;  // oldest first

  bool stalled() const { return age_s > 2; }  // the flight's thread is silent: nothing here is news
};

// Throws Error when the text is no state.
WatchedStatus parse_watched_status(std::string_view json);

}  // namespace nadir
