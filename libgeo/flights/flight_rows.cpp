#include "flights/flight_rows.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "base/error.hpp"
#include "base/printable.hpp"
#include "imagery/sqlite_database.hpp"
#include "recorder/record_codec.hpp"

namespace nadir {
namespace {

constexpr const char* kPictureColumns =
    "SELECT frame, name, state, reason, sha256, bytes, width, height, telemetry FROM picture";

// Frame numbers and sizes are never so large that this loses anything.
std::int64_t signed_of(std::uint64_t number) { return static_cast<std::int64_t>(number); }

Bytes session_bytes(SessionRecord session) {
  session.id.clear();
  session.segment = 0;
  session.started_ns = 0;
  return encode(Record(std::move(session)));
}

std::string text_of(const PictureRefusal& refusal) {
  return fmt::format("{}: {}", name_of(refusal.problem), refusal.reason);
}

Bytes bytes_of(ByteView blob) { return {blob.begin(), blob.end()}; }

}  // namespace

std::string_view name_of(PictureState state) {
  switch (state) {
    case PictureState::accepted: return "accepted";
    case PictureState::processed: return "processed";
    case PictureState::refused: return "refused";
  }
  return {};
}

std::string_view name_of(EstimateKind kind) {
  switch (kind) {
    case EstimateKind::online: return "online";
    case EstimateKind::refined: return "refined";
    case EstimateKind::adjusted: return "adjusted";
    case EstimateKind::placed: return "placed";
  }
  return {};
}

bool same_flight(const FlightDescription& one, const FlightDescription& other) {
  return session_bytes(one.session) == session_bytes(other.session);
}

void FlightRows::refuse_damaged(std::string found) const {
  throw Error({.what = "the stored flight is damaged",
               .where = database_.path(),
               .expected = "rows as they were stored",
               .found = std::move(found),
               .fix = "get the flight from a backup, or process its pictures again"});
}

std::int64_t FlightRows::scalar(std::string_view sql) const {
  auto statement = database_.prepare(sql);
  return statement.step() ? statement.integer(0) : 0;
}

// ---- The flight

void FlightRows::insert_flight(const FlightDescription& flight, UtcMillis now) const {
  const Bytes session = encode(Record(flight.session));
  const std::optional<LonLat>& start = flight.session.start;
  auto insert = database_.prepare(
      "INSERT INTO flight (id, name, package, camera, start_lat_deg, start_lon_deg, created_ms, session) "
      "VALUES (1, ?, ?, ?, ?, ?, ?, ?)");
  insert.bind(1, flight.name).bind(2, flight.package).bind(3, flight.camera_text);
  insert.bind_real(4, start ? std::optional(start->lat_deg) : std::nullopt);
  insert.bind_real(5, start ? std::optional(start->lon_deg) : std::nullopt);
  insert.bind(6, now.unix_ms).bind(7, ByteView(session)).run();
}

FlightRows::Flight FlightRows::flight() const {
  Flight flight;
  auto row = database_.prepare("SELECT name, package, camera, outside, session FROM flight");
  if (!row.step()) refuse_damaged("no row in the table flight");
  flight.description.name = row.text(0);
  flight.description.package = row.text(1);
  flight.description.camera_text = row.text(2);
  if (!row.is_null(3)) flight.outside = row.text(3);
  const auto record = decode(Topic::session, row.blob(4));
  if (!record) refuse_damaged("a session that cannot be read");
  flight.description.session = std::get<SessionRecord>(*record);
  flight.accepted = static_cast<std::size_t>(scalar("SELECT count(*) FROM picture WHERE frame IS NOT NULL"));
  flight.processed = static_cast<std::size_t>(scalar("SELECT count(*) FROM picture WHERE state = 'processed'"));
  const std::int64_t last = scalar("SELECT ifnull(max(frame), -1) FROM picture");
  const std::int64_t done = scalar("SELECT ifnull(max(frame), -1) FROM picture WHERE state = 'processed'");
  if (last + 1 != signed_of(flight.accepted) || done + 1 != signed_of(flight.processed)) {
    refuse_damaged("frames that do not count from 0 without gaps");
  }
  return flight;
}

void FlightRows::set_outside(const std::filesystem::path& folder) const {
  database_.prepare("UPDATE flight SET outside = ?").bind(1, folder.string()).run();
}

// ---- Pictures

void FlightRows::insert_pictures(const std::map<std::size_t, NewPicture>& added) const {
  auto insert = database_.prepare(
      "INSERT INTO picture (frame, name, file, sha256, bytes, width, height, time_s, telemetry, state, reason) "
      "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, 'accepted', '')");
  for (const auto& [frame, picture] : added) {
    const PictureFacts& facts = picture.facts;
    const Bytes telemetry = encode(Record(InputRecord{frame, picture.telemetry, facts.sha256, facts.bytes}));
    insert.bind(1, signed_of(frame)).bind(2, picture.telemetry.frame).bind(3, picture.file);
    insert.bind(4, ByteView(facts.sha256.bytes)).bind(5, signed_of(facts.bytes));
    insert.bind(6, std::int64_t{facts.width}).bind(7, std::int64_t{facts.height});
    insert.bind_real(8, picture.telemetry.time_s).bind(9, ByteView(telemetry)).run();
  }
}

void FlightRows::insert_outside_pictures(std::span<const Telemetry> frames, std::span<const std::string> files) const {
  auto insert = database_.prepare(
      "INSERT INTO picture (frame, name, file, time_s, telemetry, state, reason) "
      "VALUES (?, ?, ?, ?, ?, 'accepted', '')");
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const Bytes telemetry = encode(Record(InputRecord{i, frames[i], Sha256{}, 0}));
    insert.bind(1, signed_of(i)).bind(2, frames[i].frame).bind(3, files.empty() ? frames[i].frame : files[i]);
    insert.bind_real(4, frames[i].time_s).bind(5, ByteView(telemetry)).run();
  }
}

void FlightRows::insert_refusals(std::span<const PictureAnswer> answers, std::size_t at_most) const {
  auto stored = static_cast<std::size_t>(scalar("SELECT count(*) FROM picture WHERE state = 'refused'"));
  auto insert = database_.prepare("INSERT INTO picture (name, file, state, reason) VALUES (?, '', 'refused', ?)");
  for (const PictureAnswer& answer : answers) {
    if (!answer.refusal || stored++ >= at_most) continue;
    insert.bind(1, printable(answer.name.substr(0, 255))).bind(2, text_of(*answer.refusal)).run();
  }
}

PictureRow FlightRows::picture_row(const SqliteStatement& row) const {
  PictureRow picture;
  if (!row.is_null(0)) picture.frame = static_cast<std::size_t>(row.integer(0));
  picture.name = row.text(1);
  for (const PictureState state : {PictureState::accepted, PictureState::processed, PictureState::refused}) {
    if (row.text(2) == name_of(state)) picture.state = state;
  }
  picture.reason = row.text(3);
  if (const ByteView digest = row.blob(4); digest.size() == picture.sha256.emplace().bytes.size()) {
    std::copy(digest.begin(), digest.end(), picture.sha256->bytes.begin());
  } else {
    picture.sha256.reset();
  }
  picture.bytes = static_cast<std::uint64_t>(row.integer(5));
  picture.width = static_cast<int>(row.integer(6));
  picture.height = static_cast<int>(row.integer(7));
  if (!picture.frame) return picture;
  const auto input = decode(Topic::input, row.blob(8));
  if (!input) refuse_damaged(fmt::format("frame {} without its telemetry", *picture.frame));
  picture.telemetry = std::get<InputRecord>(*input).telemetry;
  return picture;
}

PictureRow FlightRows::picture(std::size_t frame) const {
  auto row = database_.prepare(fmt::format("{} WHERE frame = ?", kPictureColumns));
  if (!row.bind(1, signed_of(frame)).step()) refuse_damaged(fmt::format("no frame {}", frame));
  return picture_row(row);
}

std::string FlightRows::file_of(std::size_t frame) const {
  auto row = database_.prepare("SELECT file FROM picture WHERE frame = ?");
  if (!row.bind(1, signed_of(frame)).step()) refuse_damaged(fmt::format("no frame {}", frame));
  const std::filesystem::path file(row.text(0));
  if (file.empty() || file.filename() != file || file == "." || file == "..") {
    refuse_damaged(fmt::format("a path as the file of frame {}", frame));
  }
  return file.string();
}

std::optional<std::size_t> FlightRows::frame_named(std::string_view name) const {
  auto row = database_.prepare("SELECT frame FROM picture WHERE name = ? AND frame IS NOT NULL");
  if (!row.bind(1, name).step()) return std::nullopt;
  return static_cast<std::size_t>(row.integer(0));
}

std::optional<std::size_t> FlightRows::frame_with(const Sha256& content) const {
  auto row = database_.prepare("SELECT frame FROM picture WHERE sha256 = ? AND frame IS NOT NULL");
  if (!row.bind(1, ByteView(content.bytes)).step()) return std::nullopt;
  return static_cast<std::size_t>(row.integer(0));
}

std::uint64_t FlightRows::picture_bytes() const {
  return static_cast<std::uint64_t>(scalar("SELECT ifnull(sum(bytes), 0) FROM picture"));
}

std::set<std::string> FlightRows::kept_files() const {
  std::set<std::string> files;
  auto rows = database_.prepare("SELECT file FROM picture WHERE frame IS NOT NULL");
  while (rows.step()) files.insert(std::string(rows.text(0)));
  return files;
}

std::vector<PictureRow> FlightRows::refused() const {
  std::vector<PictureRow> refused;
  auto rows = database_.prepare(fmt::format("{} WHERE frame IS NULL ORDER BY id", kPictureColumns));
  while (rows.step()) refused.push_back(picture_row(rows));
  return refused;
}

// ---- Results

void FlightRows::insert_frame(const ProcessedFrame& frame, UtcMillis now) const {
  auto update = database_.prepare("UPDATE picture SET state = 'processed', bytes = coalesce(?, bytes) WHERE frame = ?");
  if (frame.picture_bytes) update.bind(1, signed_of(*frame.picture_bytes));
  update.bind(2, signed_of(frame.frame)).run();
  database_.prepare("INSERT INTO measurement (frame, answers) VALUES (?, ?)")
      .bind(1, signed_of(frame.frame))
      .bind(2, ByteView(frame.answers))
      .run();
  if (!frame.seen.empty() || !frame.map.empty()) {
    database_.prepare("INSERT INTO look (frame, seen, map) VALUES (?, ?, ?)")
        .bind(1, signed_of(frame.frame))
        .bind(2, ByteView(frame.seen))
        .bind(3, ByteView(frame.map))
        .run();
  }
  insert_estimate(EstimateKind::online, frame.online, &frame.anchor);
  for (const FlightSegment& segment : frame.segments) insert_segment(segment);
  for (const StoredFlightEvent& event : frame.events) insert_event(event, now);
}

StoredFrame FlightRows::stored_frame(std::size_t frame) const {
  auto row = database_.prepare(
      "SELECT e.record, m.answers, l.seen, l.map FROM estimate e JOIN measurement m ON m.frame = e.frame "
      "LEFT JOIN look l ON l.frame = e.frame WHERE e.frame = ? AND e.kind = 'online'");
  if (!row.bind(1, signed_of(frame)).step()) {
    refuse_damaged(fmt::format("no results of frame {}", frame));
  }
  const auto record = decode(Topic::estimate, row.blob(0));
  if (!record) refuse_damaged(fmt::format("no readable estimate of frame {}", frame));
  return {std::get<EstimateRecord>(*record), bytes_of(row.blob(1)), bytes_of(row.blob(2)), bytes_of(row.blob(3))};
}

AnchorReport FlightRows::look_of(std::size_t frame) const {
  auto row = database_.prepare("SELECT anchor FROM estimate WHERE frame = ? AND kind = 'online'");
  const bool found = row.bind(1, signed_of(frame)).step();
  const auto record = found ? decode(Topic::anchor, row.blob(0)) : std::nullopt;
  if (!record) refuse_damaged(fmt::format("no readable look of frame {}", frame));
  return std::get<AnchorRecord>(*record).anchor;
}

void FlightRows::replace_estimates(EstimateKind kind, std::span<const Estimate> estimates) const {
  database_.prepare("DELETE FROM estimate WHERE kind = ?").bind(1, name_of(kind)).run();
  for (std::size_t i = 0; i < estimates.size(); ++i) insert_estimate(kind, {i, estimates[i], {}, {}}, nullptr);
}

void FlightRows::insert_estimate(EstimateKind kind, const EstimateRecord& record, const AnchorReport* anchor) const {
  const Estimate& estimate = record.estimate;
  const Bytes bytes = encode(Record(record));
  Bytes anchor_bytes;
  auto insert = database_.prepare(
      "INSERT INTO estimate (frame, kind, lat_deg, lon_deg, sigma_m, cov_ee_m2, cov_en_m2, cov_nn_m2, hpl_m, source, "
      "segment, verdict, latency_ms, record, anchor) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  insert.bind(1, signed_of(record.index)).bind(2, name_of(kind));
  if (estimate.position) {
    insert.bind_real(3, estimate.position->lat_deg).bind_real(4, estimate.position->lon_deg);
    insert.bind_real(5, estimate.sigma_m).bind_real(6, estimate.covariance_m2(0, 0));
    insert.bind_real(7, estimate.covariance_m2(0, 1)).bind_real(8, estimate.covariance_m2(1, 1));
  }
  insert.bind_real(9, estimate.hpl_m).bind(10, name_of(estimate.source)).bind(11, std::int64_t{estimate.segment});
  insert.bind(12, name_of(anchor != nullptr ? anchor->verdict : AnchorVerdict::not_tried));
  insert.bind_real(13, estimate.latency_ms).bind(14, ByteView(bytes));
  if (anchor != nullptr) {
    anchor_bytes = encode(Record(AnchorRecord{record.index, estimate.frame, estimate.time_s, *anchor, record.index}));
    insert.bind(15, ByteView(anchor_bytes));
  }
  insert.run();
}

std::vector<Estimate> FlightRows::estimates(EstimateKind kind, std::size_t first, std::size_t most) const {
  std::vector<Estimate> estimates;
  auto rows = database_.prepare(
      kind == EstimateKind::refined
          ? "SELECT ifnull(p.record, e.record) FROM estimate e LEFT JOIN estimate p ON p.frame = e.frame AND "
            "p.kind = 'placed' WHERE e.kind = ? AND e.frame >= ? ORDER BY e.frame LIMIT ?"
          : "SELECT record FROM estimate WHERE kind = ? AND frame >= ? ORDER BY frame LIMIT ?");
  rows.bind(1, name_of(kind)).bind(2, signed_of(std::min(first, std::size_t{INT32_MAX})));
  rows.bind(3, signed_of(std::min(most, std::size_t{INT32_MAX})));
  while (rows.step()) {
    const auto record = decode(Topic::estimate, rows.blob(0));
    if (!record) refuse_damaged("an estimate that cannot be read");
    estimates.push_back(std::get<EstimateRecord>(*record).estimate);
  }
  return estimates;
}

void FlightRows::replace_estimate(EstimateKind kind, std::size_t frame, const Estimate& estimate) const {
  database_.prepare("DELETE FROM estimate WHERE kind = ? AND frame = ?")
      .bind(1, name_of(kind))
      .bind(2, signed_of(frame))
      .run();
  insert_estimate(kind, {frame, estimate, {}, {}}, nullptr);
}

std::optional<EstimateRecord> FlightRows::placed_estimate(std::size_t frame) const {
  auto row = database_.prepare("SELECT record FROM estimate WHERE kind = 'placed' AND frame = ?");
  if (!row.bind(1, signed_of(frame)).step()) return std::nullopt;
  const auto record = decode(Topic::estimate, row.blob(0));
  if (!record) refuse_damaged("an estimate that cannot be read");
  return std::get<EstimateRecord>(*record);
}

std::vector<EstimateRecord> FlightRows::placed_estimates() const {
  std::vector<EstimateRecord> placed;
  auto rows = database_.prepare("SELECT record FROM estimate WHERE kind = 'placed' ORDER BY frame");
  while (rows.step()) {
    const auto record = decode(Topic::estimate, rows.blob(0));
    if (!record) refuse_damaged("an estimate that cannot be read");
    placed.push_back(std::get<EstimateRecord>(*record));
  }
  return placed;
}

// ---- Segments and events

void FlightRows::insert_merged_segment(const FlightSegment& segment, std::span<const EstimateRecord> placed,
                                       std::span<const int> basis) const {
  insert_segment(segment);
  for (const EstimateRecord& record : placed) insert_estimate(EstimateKind::placed, record, nullptr);
  auto insert = database_.prepare("INSERT INTO merge_basis (segment, basis) VALUES (?, ?)");
  for (const int each : basis) insert.bind(1, std::int64_t{segment.number}).bind(2, std::int64_t{each}).run();
}

std::vector<int> FlightRows::merged_on(int basis) const {
  std::vector<int> merged;
  auto rows = database_.prepare("SELECT segment FROM merge_basis WHERE basis = ? ORDER BY segment");
  rows.bind(1, std::int64_t{basis});
  while (rows.step()) merged.push_back(static_cast<int>(rows.integer(0)));
  return merged;
}

void FlightRows::insert_segment(const FlightSegment& segment) const {
  database_
      .prepare(
          "DELETE FROM estimate WHERE kind = 'placed' AND segment = ? AND EXISTS (SELECT 1 FROM segment WHERE "
          "segment = ? AND state = 'merged')")
      .bind(1, std::int64_t{segment.number})
      .bind(2, std::int64_t{segment.number})
      .run();
  database_.prepare("DELETE FROM merge_basis WHERE segment = ?").bind(1, std::int64_t{segment.number}).run();
  // Not REPLACE: it deletes the row that others' placements refer to.
  auto insert = database_.prepare(
      "INSERT INTO segment (segment, first_frame, last_frame, state, anchored_frame) VALUES (?, ?, ?, ?, ?) "
      "ON CONFLICT (segment) DO UPDATE SET first_frame = excluded.first_frame, last_frame = excluded.last_frame, "
      "state = excluded.state, anchored_frame = excluded.anchored_frame");
  insert.bind(1, std::int64_t{segment.number}).bind(2, signed_of(segment.first_frame));
  insert.bind(3, signed_of(segment.last_frame)).bind(4, name_of(segment.state));
  if (segment.anchored_frame) {
    insert.bind(5, signed_of(*segment.anchored_frame));
  } else {
    insert.bind_null(5);
  }
  insert.run();
}

std::vector<FlightSegment> FlightRows::segments() const {
  std::vector<FlightSegment> segments;
  auto rows =
      database_.prepare("SELECT segment, first_frame, last_frame, state, anchored_frame FROM segment ORDER BY segment");
  while (rows.step()) {
    FlightSegment& segment = segments.emplace_back();
    segment.number = static_cast<int>(rows.integer(0));
    segment.first_frame = static_cast<std::size_t>(rows.integer(1));
    segment.last_frame = static_cast<std::size_t>(rows.integer(2));
    for (const SegmentState state : {SegmentState::floating, SegmentState::anchored, SegmentState::merged}) {
      if (rows.text(3) == name_of(state)) segment.state = state;
    }
    if (!rows.is_null(4)) segment.anchored_frame = static_cast<std::size_t>(rows.integer(4));
  }
  return segments;
}

void FlightRows::insert_event(const StoredFlightEvent& event, UtcMillis now) const {
  auto insert = database_.prepare("INSERT INTO event (time_ms, kind, frame, body) VALUES (?, ?, ?, ?)");
  insert.bind(1, now.unix_ms).bind(2, name_of(event.kind));
  if (event.frame) {
    insert.bind(3, signed_of(*event.frame));
  } else {
    insert.bind_null(3);
  }
  insert.bind(4, event.body).run();
}

bool FlightRows::has_event(const StoredFlightEvent& event) const {
  auto row = database_.prepare("SELECT 1 FROM event WHERE kind = ? AND frame IS ? AND body = ?");
  row.bind(1, name_of(event.kind));
  if (event.frame) {
    row.bind(2, signed_of(*event.frame));
  } else {
    row.bind_null(2);
  }
  return row.bind(3, event.body).step();
}

bool FlightRows::has_event(FlightEventKind kind, std::size_t frame) const {
  auto row = database_.prepare("SELECT 1 FROM event WHERE kind = ? AND frame = ?");
  return row.bind(1, name_of(kind)).bind(2, signed_of(frame)).step();
}

std::int64_t FlightRows::last_event() const { return scalar("SELECT ifnull(max(id), 0) FROM event"); }

std::vector<EventRow> FlightRows::events_after(std::int64_t id, std::size_t most) const {
  auto rows = database_.prepare("SELECT id, time_ms, kind, frame, body FROM event WHERE id > ? ORDER BY id LIMIT ?");
  return event_rows(rows.bind(1, id).bind(2, signed_of(most)));
}

std::vector<EventRow> FlightRows::events_of(FlightEventKind kind) const {
  auto rows = database_.prepare("SELECT id, time_ms, kind, frame, body FROM event WHERE kind = ? ORDER BY id");
  return event_rows(rows.bind(1, name_of(kind)));
}

std::vector<EventRow> FlightRows::event_rows(SqliteStatement& rows) const {
  std::vector<EventRow> events;
  while (rows.step()) {
    const auto kind = parse_flight_event(rows.text(2));
    if (!kind) refuse_damaged("an unknown event");
    EventRow& row = events.emplace_back();
    row.id = rows.integer(0);
    row.time = {rows.integer(1)};
    row.event.kind = *kind;
    if (!rows.is_null(3)) row.event.frame = static_cast<std::size_t>(rows.integer(3));
    row.event.body = rows.text(4);
  }
  return events;
}

}  // namespace nadir
