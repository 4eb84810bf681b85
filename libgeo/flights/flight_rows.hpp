// Rows of the tables flight, picture, measurement, look, estimate, segment and event (docs/formats/flight.md): what a
// stored flight consists of, and the SQL that writes and reads it. What people say has tables of its own
// (flight_annotations.hpp). What is read back is checked: rows that nobody stored so are an Error, "the stored flight
// is damaged".
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.hpp"
#include "base/time.hpp"
#include "estimation/estimate.hpp"
#include "estimation/telemetry.hpp"
#include "flights/picture_intake.hpp"
#include "flights/segment_tracker.hpp"
#include "geodesy/lon_lat.hpp"
#include "recorder/records.hpp"

namespace nadir {

class SqliteDatabase;
class SqliteStatement;

// What a flight is localized with. It never changes.
struct FlightDescription {
  std::string name;
  std::string package;      // where its map lies, as its owner calls it; empty: odometry alone
  std::string camera_text;  // camera.yaml as it was given; empty: only the values in `session` are known
  SessionRecord session;    // every bit that the localizer starts from
};

// Whether both give the same localizer.
bool same_flight(const FlightDescription& one, const FlightDescription& other);

enum class PictureState { accepted, processed, refused };
std::string_view name_of(PictureState state);

struct PictureRow {
  std::optional<std::size_t> frame;  // from 0 without gaps; nothing: refused
  std::string name;
  PictureState state = PictureState::accepted;
  std::string reason;            // of a refused one: "PROBLEM: text"
  std::optional<Sha256> sha256;  // of pictures that the store keeps
  std::uint64_t bytes = 0;
  int width = 0, height = 0;
  Telemetry telemetry;
};

struct EventRow {
  std::int64_t id = 0;  // grows, from 1
  UtcMillis time;
  StoredFlightEvent event;
};

// The results of a frame. Images of the look are JPEG, empty where they are not kept.
struct ProcessedFrame {
  std::size_t frame = 0;
  Bytes answers;          // encode_answers()
  EstimateRecord online;  // with its latency
  AnchorReport anchor;
  Bytes seen, map;
  std::optional<std::uint64_t> picture_bytes;  // of a picture outside: so many had been read
  std::vector<FlightSegment> segments;         // that began or changed
  std::vector<StoredFlightEvent> events;
};

struct StoredFrame {
  EstimateRecord online;
  Bytes answers, seen, map;
};

enum class EstimateKind {
  online,    // as it was known when the frame was processed
  refined,   // by smoothing over the whole flight
  adjusted,  // by block adjustment
  placed     // of the frames of merged segments only, by their placement; shown as refined ones
};
std::string_view name_of(EstimateKind kind);

// Callers hold the store's lock, and a transaction for what changes.
class FlightRows {
 public:
  // database: must outlive this.
  explicit FlightRows(const SqliteDatabase& database) : database_(database) {}

  struct Flight {
    FlightDescription description;
    std::string outside;  // the folder of pictures that the flight refers to, as its creator called it; empty: none
    std::size_t accepted = 0, processed = 0;  // frames
  };
  void insert_flight(const FlightDescription& flight, UtcMillis now) const;
  Flight flight() const;
  void set_outside(const std::filesystem::path& folder) const;

  void insert_pictures(const std::map<std::size_t, NewPicture>& added) const;
  // Of pictures that lie outside. files: their names; empty: those of the telemetry's frames.
  void insert_outside_pictures(std::span<const Telemetry> frames, std::span<const std::string> files) const;
  void insert_refusals(std::span<const PictureAnswer> answers, std::size_t at_most) const;  // stored ones included
  PictureRow picture(std::size_t frame) const;
  std::string file_of(std::size_t frame) const;  // its name in the folder of the pictures: never a path
  std::optional<std::size_t> frame_named(std::string_view name) const;
  std::optional<std::size_t> frame_with(const Sha256& content) const;
  std::uint64_t picture_bytes() const;  // all together
  std::set<std::string> kept_files() const;
  std::vector<PictureRow> refused() const;

  void insert_frame(const ProcessedFrame& frame, UtcMillis now) const;
  StoredFrame stored_frame(std::size_t frame) const;
  AnchorReport look_of(std::size_t frame) const;

  // In the order of frames, from 0; they replace all of that kind.
  void replace_estimates(EstimateKind kind, std::span<const Estimate> estimates) const;
  // Of refined ones those of merged segments are the placed ones, whatever else was stored for their frames.
  std::vector<Estimate> estimates(EstimateKind kind, std::size_t first, std::size_t most) const;
  std::vector<EstimateRecord> placed_estimates() const;  // by frame, with heading and height as they were placed
  std::optional<EstimateRecord> placed_estimate(std::size_t frame) const;
  void replace_estimate(EstimateKind kind, std::size_t frame, const Estimate& estimate) const;

  // Or replaces it: one that was merged and is something else again has no placed estimates any more.
  void insert_segment(const FlightSegment& segment) const;
  // basis: segments that its placement rests on.
  void insert_merged_segment(const FlightSegment& segment, std::span<const EstimateRecord> placed,
                             std::span<const int> basis) const;
  std::vector<int> merged_on(int basis) const;  // segments whose placement rests on this one
  std::vector<FlightSegment> segments() const;

  void insert_event(const StoredFlightEvent& event, UtcMillis now) const;
  bool has_event(const StoredFlightEvent& event) const;  // the same, at any time
  bool has_event(FlightEventKind kind, std::size_t frame) const;
  std::int64_t last_event() const;
  std::vector<EventRow> events_after(std::int64_t id, std::size_t most) const;
  std::vector<EventRow> events_of(FlightEventKind kind) const;

 private:
  [[noreturn]] void refuse_damaged(std::string found) const;
  std::int64_t scalar(std::string_view sql) const;
  PictureRow picture_row(const SqliteStatement& row) const;
  std::vector<EventRow> event_rows(SqliteStatement& rows) const;
  void insert_estimate(EstimateKind kind, const EstimateRecord& record, const AnchorReport* anchor) const;

  const SqliteDatabase& database_;
};

}  // namespace nadir
