// What the flight recorder records, and how MCAP names it. schemas/recorder/*.fbs define the same on disk;
// docs/formats/recorder.md says what each record is for. `index` counts the frames of a session from 0.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "base/bytes.hpp"
#include "base/digest.hpp"
#include "estimation/estimate.hpp"
#include "estimation/localizer.hpp"
#include "estimation/telemetry.hpp"
#include "geodesy/web_mercator.hpp"
#include "recorder/mcap_format.hpp"
#include "vision/camera.hpp"

namespace nadir {

// The configuration of the flight: everything that the localizer started from.
struct SessionRecord {
  std::string id;
  std::uint32_t segment = 0;     // filled in by the recorder
  std::uint64_t started_ns = 0;  // since 1970, UTC
  std::string program, version, airframe;
  std::optional<Sha256> package;  // of manifest.json; none: no map
  std::string mission;
  CameraFile camera;
  LonLat origin;                // of the plane in which everything is estimated
  std::optional<LonLat> start;  // where the flight began, if it was known
  int picture_shrink = 1;       // images were decoded at 1 / this of their size
  std::uint64_t seed = 0;
  LocalizerConfig localizer;  // of its surface, places and matchability only whether there were any
  bool terrain = false;       // the package's terrain was the surface; else flat ground
  bool places = true;         // the package's place index was used, if it has one
  bool matchability = false;  // the package's matchability map was used
  std::vector<std::pair<std::string, std::string>> settings;  // other options
  bool looked_up_later = false;                               // Localizer::follow() and finish(); else process()
};

// The localizer's input for one frame.
struct InputRecord {
  std::uint64_t index = 0;
  Telemetry telemetry;
  Sha256 picture;  // of the encoded bytes
  std::uint64_t picture_bytes = 0;
};

struct FrameRecord {
  std::uint64_t index = 0;
  std::string frame;
  Bytes encoded;  // JPEG, PNG or WebP, as it came
};

struct EstimateRecord {
  std::uint64_t index = 0;
  Estimate estimate;
  OdometryReport odometry;
  StateEstimate state;
};

struct AnchorRecord {
  std::uint64_t index = 0;
  std::string frame;
  double time_s = 0;
  AnchorReport anchor;            // without its images
  std::uint64_t taken_after = 0;  // the last frame that had been followed then: `index`, unless it was looked up later
};

// A call of Localizer::hint().
struct HintRecord {
  std::uint64_t before = 0;  // the frame that was followed next
  LonLat place;
  double radius_m = 0;
  std::string by;  // "operator", "API", "GPS", "restart"
};

struct StateRecord {
  std::string from, to, reason;
};

struct TileRecord {
  TileKey key;
  std::string code;  // of the finding
  std::string text;
};

struct HealthRecord {
  bool healthy = true;
  std::vector<std::pair<std::string, double>> measures;  // units are in the names: "memory_mb"
  std::vector<std::string> notes;
};

struct ThumbnailRecord {
  std::uint64_t index = 0;
  std::string frame;
  AnchorVerdict verdict = AnchorVerdict::not_tried;
  Bytes seen, map;  // JPEG
};

enum class RecorderEventKind { dropped_by_queue, dropped_by_disk, stopped, resumed, segment_deleted };

std::string_view name_of(RecorderEventKind kind);

// The recorder about itself: what is not in the recording, and why.
struct RecorderRecord {
  RecorderEventKind kind = RecorderEventKind::stopped;
  std::string topic;
  std::uint64_t count = 0;  // records; bytes of a deleted segment
  std::string text;
};

struct EndRecord {
  bool clean_shutdown = false;
  std::uint64_t records = 0;  // written before this one
  std::uint64_t dropped = 0;
  std::string reason;
};

// GPS_INPUT as it was sent to the autopilot, and what its real GPS receiver said last.
struct FixRecord {
  double time_s = 0;         // monotonic, when it was sent
  std::int64_t unix_us = 0;  // the time that it is valid at
  int fix_type = 0;          // GPS_FIX_TYPE: 0 is "no fix"
  SourceLabel source = SourceLabel::no_fix;
  std::optional<LonLat> place;
  std::optional<double> msl_m, accuracy_m, vertical_accuracy_m;
  std::optional<double> north_mps, east_mps, down_mps, speed_accuracy_mps;

  struct Receiver {
    double age_s = 0;  // of the message when the fix was sent
    int fix_type = 0;
    LonLat place;
    double msl_m = 0;
    std::optional<double> accuracy_m;
  };
  std::optional<Receiver> gps;
};

// What the service says about the position when a fix is due.
struct FixStatus {
  bool served = false;     // GPS_INPUT is sent at all: with the position, or as "no fix"
  bool permitted = false;  // the position may be sent
  SourceLabel source = SourceLabel::no_fix;
  double sigma_m = 0;  // the accuracy that is sent is at least this
};

// What entered the fix stream (fixes/fix_stream.hpp) since the last fix was due, and the turn at which this one was.
struct FixInputRecord {
  struct Attitude {
    float roll_rad = 0, pitch_rad = 0, yaw_rad = 0;
  };
  struct Acceleration {  // specific force of the first IMU
    float forward_mps2 = 0, right_mps2 = 0, down_mps2 = 0;
  };
  struct ArrivedEstimate {
    std::uint64_t index = 0;  // of its EstimateRecord
    bool late = false;        // the second one of that index, after a map match
  };
  struct Input {
    std::int64_t time_us = 0;  // when it arrived, at most 2^32 us before the turn
    std::variant<Attitude, Acceleration, ArrivedEstimate> what;
  };

  std::uint64_t number = 0;  // of the turn, from 0 without gaps
  std::int64_t time_us = 0;  // monotonic
  std::int64_t unix_us = 0;  // UTC of the same moment
  FixStatus status;
  bool sent = false;          // the link took it: there is a FixRecord of this time
  std::uint32_t missing = 0;  // inputs that entered but are not in the list
  std::vector<Input> inputs;  // as they arrived
};

// In the order of Topic.
using Record =
    std::variant<SessionRecord, InputRecord, FrameRecord, EstimateRecord, AnchorRecord, StateRecord, TileRecord,
                 HealthRecord, ThumbnailRecord, RecorderRecord, EndRecord, HintRecord, FixRecord, FixInputRecord>;

// In the order of Record's alternatives.
enum class Topic {
  session,
  input,
  picture,
  estimate,
  anchor,
  state,
  tile,
  health,
  thumbnail,
  recorder,
  end,
  hint,
  fix,
  fix_input
};
inline constexpr std::size_t kTopics = 14;

inline Topic topic_of(const Record& record) { return static_cast<Topic>(record.index()); }

// Bulky records go into separate files, which can be deleted first when space is short.
enum class Stream { flight, pictures, thumbnails };
inline constexpr std::array<Stream, 3> kStreams{Stream::flight, Stream::pictures, Stream::thumbnails};

std::string_view name_of(Stream stream);  // in file names
std::optional<Stream> parse_stream(std::string_view name);

std::string_view name_of(Topic topic);  // "/estimate"
std::optional<Topic> parse_topic(std::string_view name);
Stream stream_of(Topic topic);

std::string_view schema_name_of(Topic topic);  // "nadir.recorder.Estimate"

// As in every file: channel and schema of a topic have the number topic + 1.
McapChannel mcap_channel(Topic topic);
McapSchema mcap_schema(Topic topic);

}  // namespace nadir
