#include "commands/recorder/flight_tables.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string_view>
#include <utility>

#include "base/csv.hpp"
#include "base/printable.hpp"
#include "base/time.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/local_frame.hpp"
#include "recorder/recording.hpp"

namespace nadir {
namespace {

Cell cell(const std::optional<double>& value) { return value ? Cell(*value) : Cell(); }
Cell cell(std::uint64_t value) { return static_cast<std::int64_t>(value); }
Cell cell(int value) { return static_cast<std::int64_t>(value); }
Cell cell(std::string_view value) { return std::string(value); }

Table estimates_table() {
  using enum CellType;
  return {.name = "estimates",
          .places = true,
          .columns = {{"index", integer},
                      {"frame", text},
                      {"time_s", real},
                      {"utc", text},
                      {"stage", text},
                      {"agl_m", real},
                      {"sigma_m", real},
                      {"source", text},
                      {"segment", integer},
                      {"anchor_age_s", real},
                      {"anchor_inliers", integer},
                      {"anchor_ratio", real},
                      {"latency_ms", real},
                      {"tracked", integer},
                      {"hpl_m", real}},
          .rows = {}};
}

Table anchors_table() {
  using enum CellType;
  return {.name = "anchors",
          .places = true,
          .columns = {{"index", integer},
                      {"frame", text},
                      {"time_s", real},
                      {"utc", text},
                      {"verdict", text},
                      {"score", real},
                      {"ratio", real},
                      {"inliers", integer},
                      {"patches", integer},
                      {"residual_px", real},
                      {"chi2", real},
                      {"matching_gsd_m", real},
                      {"heading_deg", real},
                      {"window_radius_m", real},
                      {"log_likelihood_ratio", real},
                      {"place_doubt", real}},
          .rows = {}};
}

Table fixes_table() {
  using enum CellType;
  return {.name = "fixes",
          .places = true,
          .columns = {{"time_s", real},
                      {"utc", text},
                      {"fix_type", integer},
                      {"source", text},
                      {"msl_m", real},
                      {"accuracy_m", real},
                      {"vertical_accuracy_m", real},
                      {"north_mps", real},
                      {"east_mps", real},
                      {"down_mps", real},
                      {"speed_accuracy_mps", real},
                      {"gps_fix_type", integer},
                      {"gps_age_s", real},
                      {"gps_lat_deg", real},
                      {"gps_lon_deg", real},
                      {"gps_msl_m", real},
                      {"gps_accuracy_m", real},
                      {"gps_distance_m", real}},
          .rows = {}};
}

// UTC of monotonic times. Every recorded fix has both; where there is none, in older recordings, an input record has
// the time of its frame and the UTC at which it was recorded, some milliseconds later.
class UtcOfMonotonic {
 public:
  void pair(double time_s, double unix_s, bool exact) {
    if (unix_s < kEarliest_s) return;  // the recording of a replay has no UTC
    if (exact && !exact_) offsets_.clear();
    if (exact || !exact_) offsets_[time_s] = unix_s - time_s;
    exact_ = exact_ || exact;
  }

  // By the pair before, so that a clock that was set in between counts from then on; empty when there is none at all.
  Cell utc(double time_s) const {
    if (offsets_.empty() || !std::isfinite(time_s)) return {};
    auto next = offsets_.upper_bound(time_s);
    if (next != offsets_.begin()) --next;
    return utc_text(time_s + next->second);
  }

  static Cell utc_text(double unix_s) {
    if (!(unix_s >= kEarliest_s && unix_s < 1e11)) return {};
    const auto ms = static_cast<std::int64_t>(std::llround(unix_s * 1e3));
    std::string text = to_rfc3339(UtcTime{ms / 1000});
    text.insert(text.size() - 1, fmt::format(".{:03}", ms % 1000));  // before the Z
    return text;
  }

 private:
  static constexpr double kEarliest_s = 946'684'800;  // 2000-01-01
  bool exact_ = false;
  std::map<double, double> offsets_;
};

Table events_table() {
  using enum CellType;
  return {.name = "events",
          .places = false,
          .columns = {{"time_unix_s", real}, {"utc", text}, {"topic", text}, {"what", text}, {"detail", text}},
          .rows = {}};
}

constexpr std::size_t kTimeColumn = 2, kUtcColumn = 3;  // of estimates and anchors

// stage: "frame" when it was made for the frame, "map_match" when a match that took longer corrected it.
TableRow row_of(const EstimateRecord& record, std::string_view stage) {
  const Estimate& e = record.estimate;
  return {e.position,
          {cell(record.index), cell(e.frame), e.time_s, Cell(), cell(stage),
           record.state.agl_m > 0 ? Cell(record.state.agl_m) : Cell(), e.position ? Cell(e.sigma_m) : Cell(),
           cell(name_of(e.source)), cell(e.segment), cell(e.anchor_age_s), cell(e.anchor_inliers), e.anchor_ratio,
           e.latency_ms, cell(record.odometry.tracked ? 1 : 0), e.position ? cell(e.hpl_m) : Cell()}};
}

TableRow row_of(const AnchorRecord& record, const LocalFrame& frame) {
  const AnchorReport& a = record.anchor;
  std::optional<LonLat> place;
  if (a.camera) place = frame.lonlat_from_plane(*a.camera);
  return {place,
          {cell(record.index), cell(record.frame), record.time_s, Cell(), cell(name_of(a.verdict)), a.score, a.ratio,
           cell(a.inliers), cell(a.patches), a.residual_px, a.chi2, a.matching_gsd_m, degrees(a.heading_rad),
           a.window_radius_m, a.log_likelihood_ratio, a.place_doubt}};
}

TableRow row_of(const FixRecord& r) {
  std::vector<Cell> cells{r.time_s,
                          UtcOfMonotonic::utc_text(static_cast<double>(r.unix_us) / 1e6),
                          cell(r.fix_type),
                          cell(name_of(r.source)),
                          cell(r.msl_m),
                          cell(r.accuracy_m),
                          cell(r.vertical_accuracy_m),
                          cell(r.north_mps),
                          cell(r.east_mps),
                          cell(r.down_mps),
                          cell(r.speed_accuracy_mps)};
  if (!r.gps) {
    cells.resize(fixes_table().columns.size());
    return {r.place, std::move(cells)};
  }
  const bool has_place = r.gps->fix_type >= 2;
  const auto from_our_fix = [&]() -> Cell {
    if (!has_place || !r.place) return {};
    return distance_m(PlanePoint(), LocalFrame(*r.place).plane_from_lonlat(r.gps->place));
  };
  cells.insert(cells.end(), {cell(r.gps->fix_type), r.gps->age_s, has_place ? Cell(r.gps->place.lat_deg) : Cell(),
                             has_place ? Cell(r.gps->place.lon_deg) : Cell(), has_place ? Cell(r.gps->msl_m) : Cell(),
                             cell(r.gps->accuracy_m), from_our_fix()});
  return {r.place, std::move(cells)};
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

Table fixes_table(const std::vector<FixRecord>& fixes) {
  Table table = fixes_table();
  for (const FixRecord& fix : fixes) table.rows.push_back(row_of(fix));
  return table;
}

FlightTables read_flight_tables(const std::filesystem::path& recording, const std::optional<std::string>& session) {
  FlightTables tables{chosen_session(recording, session), estimates_table(), anchors_table(), fixes_table(),
                      events_table()};
  UtcOfMonotonic clock;
  std::uint64_t next_index = 0;
  std::optional<LocalFrame> frame;
  read_recording(recording, [&](const Recorded& one) {
    if (!one.segment.session || one.segment.session->id != tables.session) return;
    if (!frame) frame.emplace(one.segment.session->origin);
    if (const auto* estimate = std::get_if<EstimateRecord>(&one.record)) {
      tables.estimates.rows.push_back(row_of(*estimate, estimate->index < next_index ? "map_match" : "frame"));
      next_index = std::max(next_index, estimate->index + 1);
    } else if (const auto* anchor = std::get_if<AnchorRecord>(&one.record)) {
      tables.anchors.rows.push_back(row_of(*anchor, *frame));
    } else if (const auto* fix = std::get_if<FixRecord>(&one.record)) {
      clock.pair(fix->time_s, static_cast<double>(fix->unix_us) / 1e6, true);
      tables.fixes.rows.push_back(row_of(*fix));
    } else if (const auto* input = std::get_if<InputRecord>(&one.record)) {
      clock.pair(input->telemetry.time_s, static_cast<double>(one.at_ns) / 1e9, false);
    } else if (const auto event = event_text(one.record)) {
      tables.events.rows.push_back(
          {std::nullopt,
           {static_cast<double>(one.at_ns) / 1e9, UtcOfMonotonic::utc_text(static_cast<double>(one.at_ns) / 1e9),
            cell(name_of(topic_of(one.record))), event->what, event->detail}});
    }
  });
  for (Table* table : {&tables.estimates, &tables.anchors}) {
    for (TableRow& row : table->rows) row.cells[kUtcColumn] = clock.utc(std::get<double>(row.cells[kTimeColumn]));
  }
  return tables;
}

namespace {

std::string text_of_cell(const Cell& cell) {
  if (const auto* text = std::get_if<std::string>(&cell)) return csv_cell(printable(*text));
  if (const auto* number = std::get_if<double>(&cell)) return std::isfinite(*number) ? fmt::format("{}", *number) : "";
  if (const auto* number = std::get_if<std::int64_t>(&cell)) return fmt::format("{}", *number);
  return "";
}

}  // namespace

std::string csv_of(const Table& table) {
  std::string text;
  for (const Column& column : table.columns) text += (text.empty() ? "" : ",") + column.name;
  text += table.places ? ",lat_deg,lon_deg\n" : "\n";
  for (const TableRow& row : table.rows) {
    std::string line;
    for (std::size_t i = 0; i < row.cells.size(); ++i) line += (i == 0 ? "" : ",") + text_of_cell(row.cells[i]);
    if (table.places) line += row.place ? fmt::format(",{:.9f},{:.9f}", row.place->lat_deg, row.place->lon_deg) : ",,";
    text += line + "\n";
  }
  return text;
}

}  // namespace nadir
