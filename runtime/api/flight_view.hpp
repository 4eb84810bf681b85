// What the service says about its flight at one moment. The flight's thread fills a FlightView and publishes it on the
// FlightBoard; the API, the web page and `nadir watch` show what is in it and nothing else.
//
// Times are seconds of the service's one monotonic clock, ages and durations are differences of them. Angles are in
// radians, headings clockwise from true north, attitude as in vision/camera_model.hpp. What is not known is nullopt.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/time.hpp"
#include "estimation/source_label.hpp"
#include "geodesy/lon_lat.hpp"
#include "geodesy/web_mercator.hpp"
#include "service/service_state.hpp"

namespace nadir {

enum class GpsJudgement { unknown, good, denied, spoofed };
enum class RecorderState { off, recording, limited, failed };  // limited: the disk budget leaves things out
enum class EventSeverity { info, warning, critical };          // critical: the operator must know now

std::string_view name_of(GpsJudgement judgement);
std::string_view name_of(RecorderState state);
std::string_view name_of(EventSeverity severity);

using CountsByReason = std::map<std::string, std::uint64_t>;

struct StateView {
  ServiceState state = ServiceState::boot;
  std::string reason;  // why it is so, for people
  double since_s = 0;
};

struct PositionView {
  LonLat place;
  double sigma_m = 0;  // one axis of the equivalent circular error
  double east_var_m2 = 0, north_var_m2 = 0, east_north_cov_m2 = 0;
};

struct VelocityView {
  double east_mps = 0, north_mps = 0;
};

struct FramesView {
  std::uint64_t received = 0, dropped = 0;  // dropped: a newer one was there first, or the camera had held it back
  double per_s = 0;
};

struct AnchorsView {
  std::uint64_t accepted = 0, rejected = 0;
  CountsByReason rejected_by;
};

struct LinkView {
  bool connected = false;
  bool signed_frames = false;
  std::uint64_t fixes_sent = 0;
  CountsByReason rejected_by;  // received frames that were not believed
};

struct GpsView {
  GpsJudgement judgement = GpsJudgement::unknown;
  std::string reason;
};

struct RecorderView {
  RecorderState state = RecorderState::off;
  std::string reason;
  std::uint64_t written_bytes = 0, free_bytes = 0, lost_records = 0;
};

struct PackageView {
  bool accepted = false;
  std::string reason;  // why it is not accepted
  std::string mission, series;
  std::int64_t sequence = 0;
  std::optional<UtcTime> expires;
  int min_zoom = 0, max_zoom = 0;
  std::uint64_t tiles = 0;
  bool terrain = false;  // an elevation model; else flat ground
  std::optional<LonLatBox> bounds;
  std::vector<LonLat> route;
};

struct FlightEvent {
  std::uint64_t id = 0;  // 1, 2, 3… since the service started
  double time_s = 0;
  EventSeverity severity = EventSeverity::info;
  std::string kind;  // "state", "gps", "link", "anchor", "recorder", "tile", "hint"
  std::string text;
};

struct TrackPoint {
  double time_s = 0;
  LonLat place;
  double sigma_m = 0;
  SourceLabel source = SourceLabel::no_fix;
};

struct FlightView {
  std::string boot_id;        // of this run of the service: letters and digits
  std::uint64_t version = 0;  // given by the FlightBoard: 1, 2, 3…
  double time_s = 0;
  std::optional<UtcTime> utc;
  StateView state;
  std::optional<PositionView> position;
  SourceLabel source = SourceLabel::no_fix;
  std::optional<double> anchor_age_s;
  std::optional<double> heading_rad, pitch_rad, roll_rad;
  std::optional<VelocityView> velocity;
  std::optional<double> agl_m;
  FramesView frames;
  AnchorsView anchors;
  LinkView link;
  GpsView gps;
  RecorderView recorder;
  PackageView package;
  std::vector<FlightEvent> events;  // the last ones, oldest first (flight_history.hpp)
  std::vector<TrackPoint> track;    // the last minutes, oldest first
};

}  // namespace nadir
