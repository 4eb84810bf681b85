// The state of the flight at one moment: the flight thread fills a FlightView and publishes it on the FlightBoard; the
// API, the web page and `nadir watch` show what is in it and nothing else. A recording that is played
// (flight/playback.hpp) is shown by the same view.
//
// Times are seconds of the service's one monotonic clock, ages and durations are differences of them. Angles are in
// radians, headings clockwise from true north, attitude as in vision/camera.hpp. What is not known is nullopt.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/time.hpp"
#include "estimation/source_label.hpp"
#include "geodesy/lon_lat.hpp"
#include "geodesy/web_mercator.hpp"
#include "service/mailbox.hpp"
#include "service/service_state.hpp"

namespace nadir {

enum class GpsJudgement { unknown, good, denied, spoofed };
enum class RecorderState { off, recording, limited, failed };  // limited: by the disk budget
enum class EventSeverity { info, warning, critical };          // critical: the operator must know now

std::string_view name_of(GpsJudgement judgement);
std::string_view name_of(RecorderState state);
std::string_view name_of(EventSeverity severity);

using CountsByReason = std::map<std::string, std::uint64_t>;

struct StateView {
  ServiceState state = ServiceState::boot;
  std::string reason;  // the reason, as text
  double since_s = 0;
};

struct PositionView {
  LonLat place;
  double sigma_m = 0;  // 1-sigma error per axis (equivalent circular)
  double east_var_m2 = 0, north_var_m2 = 0, east_north_cov_m2 = 0;
  std::optional<double> hpl_m{};  // protection level; nothing: no radius is known
  double at_s = 0;                // when the aircraft was there: a frame's capture, or now for one carried on since
};

// What the mission demands of a position, and whether this one meets it.
struct IntegrityView {
  bool usable = false;
  double risk = 1e-5;  // per look, of being outside the protection level
  double alert_limit_m = 100, time_to_alert_s = 3;
};

struct VelocityView {
  double east_mps = 0, north_mps = 0;
};

struct FramesView {
  std::uint64_t received = 0, dropped = 0;  // dropped: superseded, delivered late, or not decodable
  double per_s = 0;
  std::optional<double> last_s;  // arrival of the latest
};

struct AnchorsView {
  std::uint64_t accepted = 0, rejected = 0;
  std::uint64_t failed = 0;  // ended with an exception
  CountsByReason rejected_by;
};

struct LinkView {
  bool connected = false;
  std::string reason;  // why it is not connected
  bool signed_frames = false;
  std::optional<double> last_message_s;  // arrival of the autopilot's latest message
  std::uint64_t fixes_sent = 0;
  std::uint64_t rivals = 0;    // frames of others that claimed to be the autopilot
  CountsByReason rejected_by;  // received frames
  struct Station {             // besides the autopilot
    std::string role;          // "ground station", "logger"
    std::string endpoint;
    bool open = false;
    std::uint64_t sent = 0, commands = 0;
  };
  std::vector<Station> stations;
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
  std::uint64_t corrupt_tiles = 0;  // found while reading
  bool terrain = false;             // an elevation model; else flat ground
  std::optional<LonLatBox> bounds;
  std::vector<LonLat> route;
};

struct FlightEvent {
  std::uint64_t id = 0;        // 1, 2, 3… since the service started
  std::uint64_t replaces = 0;  // the id of the same event's last occurrence, whose place this takes; 0: none
  std::uint64_t count = 1;     // occurrences
  double time_s = 0;           // of the latest
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

// A recording that is shown in place of a flight. Its times are seconds since its first record.
struct PlaybackView {
  std::string session{};
  std::optional<UtcTime> recorded{};  // its first record; nothing: that of a replay, which has no date
  double at_s = 0, length_s = 0;      // the moment that is shown, and the last one
  bool playing = false;               // false: paused
  int speed = 1;                      // seconds of the recording in a second
  std::string notice{};               // what of it could not be read; empty: it is whole
};

struct FlightView {
  std::string boot_id;        // of this run of the service: letters and digits
  std::uint64_t version = 0;  // given by the FlightBoard: 1, 2, 3…
  double time_s = 0;
  std::optional<UtcTime> utc;
  StateView state;
  std::optional<PositionView> position;
  IntegrityView integrity;
  SourceLabel source = SourceLabel::no_fix;
  std::optional<double> anchored_s;  // capture of the frame that was matched last
  std::optional<double> heading_rad, pitch_rad, roll_rad;
  std::optional<VelocityView> velocity;
  std::optional<double> agl_m;
  FramesView frames;
  AnchorsView anchors;
  LinkView link;
  GpsView gps;
  RecorderView recorder;
  PackageView package;
  std::vector<FlightEvent> events;       // the last ones, oldest first (EventRing)
  std::uint64_t events_gone = 0;         // the highest id that left the list to make room
  std::vector<FlightEvent> alarms;       // the last critical ones, oldest first; other events do not displace them
  std::vector<TrackPoint> track;         // the last minutes, oldest first (FlightTrail)
  std::optional<PlaybackView> playback;  // nothing: this is a flight
};

// The history that readers see: the last events and the track of the last minutes. Bounded, so that a long flight
// costs no more than a short one.
//
// An event that repeats within the window (same severity, kind and wording, whatever the figures in it) takes the place
// of its last occurrence and counts: an intermittent camera is one line, "x 5", and displaces nothing.
class EventRing {
 public:
  explicit EventRing(std::size_t capacity = 100, double repeat_window_s = 0)
      : capacity_(capacity), repeat_window_s_(repeat_window_s) {}

  void add(double time_s, EventSeverity severity, std::string kind, std::string text);
  const std::vector<FlightEvent>& events() const { return events_; }  // oldest first
  std::uint64_t gone() const { return gone_; }                        // the highest id that left to make room

 private:
  std::size_t capacity_;
  double repeat_window_s_;
  std::uint64_t last_id_ = 0, gone_ = 0;
  std::vector<FlightEvent> events_;
};

// At most one point in each spacing_s; points older than length_s are forgotten.
class FlightTrail {
 public:
  explicit FlightTrail(double length_s = 600, double spacing_s = 1) : length_s_(length_s), spacing_s_(spacing_s) {}

  void add(const TrackPoint& point);
  const std::vector<TrackPoint>& points() const { return points_; }  // oldest first

 private:
  double length_s_;
  double spacing_s_;
  std::vector<TrackPoint> points_;
};

// Where the flight's thread publishes its latest FlightView and any number of readers look at it.
//
// publish() never waits for a reader: it is one atomic exchange. Readers only wait for each other, for the moment that
// it takes to copy a pointer.
class FlightBoard {
 public:
  // From one thread. Numbers the view.
  void publish(FlightView view);

  // From any thread. Before the first publish(): the view of a booting service.
  std::shared_ptr<const FlightView> snapshot() const;

 private:
  std::uint64_t versions_ = 0;
  mutable LatestSlot<FlightView> newest_;
  mutable std::mutex readers_;
  mutable std::shared_ptr<const FlightView> seen_ = std::make_shared<const FlightView>();
};

}  // namespace nadir
