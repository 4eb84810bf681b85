#include "commands/recorder/flight_tables.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "geodesy/angles.hpp"
#include "geodesy/local_frame.hpp"
#include "recorder/recording.hpp"
#include "replay/recorded_flight.hpp"

namespace nadir {
namespace {

using enum CellType;

Cell cell(const std::optional<double>& value) { return value ? Cell(*value) : Cell(); }
Cell cell(std::uint64_t value) { return static_cast<std::int64_t>(value); }
Cell cell(int value) { return static_cast<std::int64_t>(value); }
Cell cell(std::string_view value) { return std::string(value); }

Table estimates_table() {
  return {.name = "estimates",
          .places = true,
          .columns = {{"index", integer},
                      {"frame", text},
                      {"time_s", real},
                      {"sigma_m", real},
                      {"source", text},
                      {"segment", integer},
                      {"anchor_age_s", real},
                      {"anchor_inliers", integer},
                      {"anchor_ratio", real},
                      {"latency_ms", real},
                      {"tracked", integer}},
          .rows = {}};
}

Table anchors_table() {
  return {.name = "anchors",
          .places = true,
          .columns = {{"index", integer},
                      {"frame", text},
                      {"time_s", real},
                      {"verdict", text},
                      {"score", real},
                      {"ratio", real},
                      {"inliers", integer},
                      {"patches", integer},
                      {"residual_px", real},
                      {"chi2", real},
                      {"matching_gsd_m", real},
                      {"heading_deg", real},
                      {"window_radius_m", real}},
          .rows = {}};
}

Table events_table() {
  return {.name = "events",
          .places = false,
          .columns = {{"time_unix_s", real}, {"topic", text}, {"what", text}, {"detail", text}},
          .rows = {}};
}

TableRow row_of(const EstimateRecord& record) {
  const Estimate& e = record.estimate;
  return {e.position,
          {cell(record.index), cell(e.frame), e.time_s, e.position ? Cell(e.sigma_m) : Cell(), cell(name_of(e.source)),
           cell(e.segment), cell(e.anchor_age_s), cell(e.anchor_inliers), e.anchor_ratio, e.latency_ms,
           cell(record.odometry.tracked ? 1 : 0)}};
}

TableRow row_of(const AnchorRecord& record, const LocalFrame& frame) {
  const AnchorReport& a = record.anchor;
  std::optional<LonLat> place;
  if (a.camera) place = frame.lonlat_from_plane(*a.camera);
  return {place,
          {cell(record.index), cell(record.frame), record.time_s, cell(name_of(a.verdict)), a.score, a.ratio,
           cell(a.inliers), cell(a.patches), a.residual_px, a.chi2, a.matching_gsd_m, degrees(a.heading_rad),
           a.window_radius_m}};
}

// What and detail of everything that is neither frame nor picture.
struct EventText {
  std::string what, detail;
};
EventText event_of(const StateRecord& r) { return {r.from + " -> " + r.to, r.reason}; }
EventText event_of(const TileRecord& r) { return {r.code, to_text(r.key) + " " + r.text}; }
EventText event_of(const HealthRecord& r) {
  std::string detail;
  for (const auto& [name, value] : r.measures) detail += fmt::format("{}={} ", name, value);
  for (const std::string& note : r.notes) detail += note + " ";
  return {r.healthy ? "healthy" : "unhealthy", detail};
}
EventText event_of(const RecorderRecord& r) {
  return {std::string(name_of(r.kind)), fmt::format("{} {} {}", r.topic, r.count, r.text)};
}
EventText event_of(const HintRecord& r) {
  return {r.by, fmt::format("within {:.0f} m of {:.6f},{:.6f} before frame {}", r.radius_m, r.place.lon_deg,
                            r.place.lat_deg, r.before)};
}
EventText event_of(const EndRecord& r) { return {r.clean_shutdown ? "clean_shutdown" : "end", r.reason}; }
template <typename Other>
std::optional<EventText> event_of(const Other&) {
  return std::nullopt;
}

std::optional<EventText> event_text(const Record& record) {
  return std::visit([](const auto& kind) { return std::optional<EventText>(event_of(kind)); }, record);
}

}  // namespace

FlightTables read_flight_tables(const std::filesystem::path& recording, const std::optional<std::string>& session) {
  FlightTables tables{chosen_session(recording, session), estimates_table(), anchors_table(), events_table()};
  std::optional<LocalFrame> frame;
  read_recording(recording, [&](const Recorded& one) {
    if (!one.segment.session || one.segment.session->id != tables.session) return;
    if (!frame) frame.emplace(one.segment.session->origin);
    if (const auto* estimate = std::get_if<EstimateRecord>(&one.record)) {
      tables.estimates.rows.push_back(row_of(*estimate));
    } else if (const auto* anchor = std::get_if<AnchorRecord>(&one.record)) {
      tables.anchors.rows.push_back(row_of(*anchor, *frame));
    } else if (const auto event = event_text(one.record)) {
      tables.events.rows.push_back(
          {std::nullopt,
           {static_cast<double>(one.at_ns) / 1e9, cell(name_of(topic_of(one.record))), event->what, event->detail}});
    }
  });
  return tables;
}

}  // namespace nadir
