// nadir recorder export: a recording for other programs.
#include <ogrsf_frmts.h>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <variant>
#include <vector>

#include "base/error.hpp"
#include "base/files.hpp"
#include "base/printable.hpp"
#include "base/time.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "geodesy/angles.hpp"
#include "geodesy/local_frame.hpp"
#include "geodesy/lon_lat.hpp"
#include "raster/gdal_drivers.hpp"
#include "recorder/recording.hpp"
#include "recorder/records.hpp"
#include "replay/recorded_flight.hpp"

namespace nadir {
namespace {

using nlohmann::json;

using Cell = std::variant<std::monostate, std::int64_t, double, std::string>;  // monostate: unknown
enum class CellType { integer, real, text };

struct Column {
  std::string name;
  CellType type = CellType::real;
};

struct TableRow {
  std::optional<LonLat> place;
  std::vector<Cell> cells;
};

struct Table {
  std::string name;
  bool places = false;  // rows have places
  std::vector<Column> columns;
  std::vector<TableRow> rows;
};

struct FlightTables {
  std::string session;
  Table estimates, anchors, fixes, events;
};

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
                      {"tracked", integer}},
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
                      {"window_radius_m", real}},
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
           e.latency_ms, cell(record.odometry.tracked ? 1 : 0)}};
}

TableRow row_of(const AnchorRecord& record, const LocalFrame& frame) {
  const AnchorReport& a = record.anchor;
  std::optional<LonLat> place;
  if (a.camera) place = frame.lonlat_from_plane(*a.camera);
  return {place,
          {cell(record.index), cell(record.frame), record.time_s, Cell(), cell(name_of(a.verdict)), a.score, a.ratio,
           cell(a.inliers), cell(a.patches), a.residual_px, a.chi2, a.matching_gsd_m, degrees(a.heading_rad),
           a.window_radius_m}};
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

// A recorded session as tables. Throws as read_recording() does, and UsageError when it is not clear which session is
// meant.
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

std::string quoted(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string result = "\"";
  for (const char c : text) result += c == '"' ? std::string("\"\"") : std::string(1, c);
  return result + '"';
}

std::string csv_cell(const Cell& cell) {
  if (const auto* text = std::get_if<std::string>(&cell)) return quoted(printable(*text));
  if (const auto* number = std::get_if<double>(&cell)) return std::isfinite(*number) ? fmt::format("{}", *number) : "";
  if (const auto* number = std::get_if<std::int64_t>(&cell)) return fmt::format("{}", *number);
  return "";
}

std::string csv_of(const Table& table) {
  std::string text;
  for (const Column& column : table.columns) text += (text.empty() ? "" : ",") + column.name;
  text += table.places ? ",lat_deg,lon_deg\n" : "\n";
  for (const TableRow& row : table.rows) {
    std::string line;
    for (std::size_t i = 0; i < row.cells.size(); ++i) line += (i == 0 ? "" : ",") + csv_cell(row.cells[i]);
    if (table.places) line += row.place ? fmt::format(",{:.9f},{:.9f}", row.place->lat_deg, row.place->lon_deg) : ",,";
    text += line + "\n";
  }
  return text;
}

json json_of(const Cell& cell) {
  if (const auto* text = std::get_if<std::string>(&cell)) return *text;
  if (const auto* number = std::get_if<double>(&cell)) return std::isfinite(*number) ? json(*number) : json();
  if (const auto* number = std::get_if<std::int64_t>(&cell)) return *number;
  return {};
}

json position(LonLat place) {
  return json::array({std::round(place.lon_deg * 1e9) / 1e9, std::round(place.lat_deg * 1e9) / 1e9});
}

void add_points(json& features, const Table& table, const char* kind) {
  for (const TableRow& row : table.rows) {
    if (!row.place) continue;
    json properties{{"kind", kind}};
    for (std::size_t i = 0; i < row.cells.size(); ++i) properties[table.columns[i].name] = json_of(row.cells[i]);
    features.push_back({{"type", "Feature"},
                        {"geometry", {{"type", "Point"}, {"coordinates", position(*row.place)}}},
                        {"properties", std::move(properties)}});
  }
}

// estimates.csv, anchors.csv, fixes.csv and events.csv (RFC 4180) in a folder; positions as lat_deg and lon_deg.
void export_csv(const FlightTables& tables, const std::filesystem::path& folder) {
  for (const Table* table : {&tables.estimates, &tables.anchors, &tables.fixes, &tables.events}) {
    write_file_atomic(folder / (table->name + ".csv"), csv_of(*table));
  }
}

// One FeatureCollection (RFC 7946): the track as a line, estimates and anchors with positions as points, distinguished
// by `kind`.
std::string geojson_of(const FlightTables& tables) {
  json features = json::array(), line = json::array();
  for (const TableRow& row : tables.estimates.rows) {
    if (row.place) line.push_back(position(*row.place));
  }
  if (line.size() >= 2) {
    features.push_back({{"type", "Feature"},
                        {"geometry", {{"type", "LineString"}, {"coordinates", std::move(line)}}},
                        {"properties", {{"kind", "track"}, {"session", tables.session}}}});
  }
  add_points(features, tables.estimates, "estimate");
  add_points(features, tables.anchors, "anchor");
  add_points(features, tables.fixes, "fix");
  const json document{{"type", "FeatureCollection"}, {"features", std::move(features)}};
  return document.dump(1, ' ', false, json::error_handler_t::replace) + "\n";
}

OGRFieldType field_type(CellType type) {
  switch (type) {
    case CellType::integer: return OFTInteger64;
    case CellType::real: return OFTReal;
    case CellType::text: return OFTString;
  }
  return OFTString;
}

class Exporter {
 public:
  Exporter(const std::string& driver_name, const std::filesystem::path& path) : path_(path) {
    register_gdal_drivers();
    GDALDriver* driver = GetGDALDriverManager()->GetDriverByName(driver_name.c_str());
    if (driver == nullptr) {
      throw Error(
          {.what = "this GDAL cannot write " + driver_name,
           .where = path,
           .expected = "a GDAL with the driver " + driver_name + " (Parquet: built with Apache Arrow, or its plug-in)",
           .found = std::string("GDAL ") + GDALVersionInfo("RELEASE_NAME") + " without it, as Debian 12 has it",
           .fix = "export as csv or gpkg, and convert on a machine with such a GDAL"});
    }
    one_layer_ = driver_name == "Parquet";
    dataset_.reset(driver->Create(path.c_str(), 0, 0, 0, GDT_Unknown, nullptr));
    if (!dataset_) fail();
    wgs84_.SetWellKnownGeogCS("WGS84");
    wgs84_.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
  }

  void table(const Table& table) {
    OGRLayer* layer = make_layer(table.name, table.places ? wkbPoint : wkbNone);
    for (const Column& column : table.columns) {
      OGRFieldDefn field(column.name.c_str(), field_type(column.type));
      if (layer->CreateField(&field) != OGRERR_NONE) fail();
    }
    for (const TableRow& row : table.rows) {
      OGRFeature feature(layer->GetLayerDefn());
      for (std::size_t i = 0; i < row.cells.size(); ++i) set(feature, table.columns[i].name, row.cells[i]);
      if (row.place) {
        OGRPoint point(row.place->lon_deg, row.place->lat_deg);
        feature.SetGeometry(&point);
      }
      if (layer->CreateFeature(&feature) != OGRERR_NONE) fail();
    }
  }

  void track(const Table& estimates) {
    OGRLineString line;
    for (const TableRow& row : estimates.rows) {
      if (row.place) line.addPoint(row.place->lon_deg, row.place->lat_deg);
    }
    if (line.getNumPoints() < 2) return;
    OGRLayer* layer = make_layer("track", wkbLineString);
    OGRFeature feature(layer->GetLayerDefn());
    feature.SetGeometry(&line);
    if (layer->CreateFeature(&feature) != OGRERR_NONE) fail();
  }

  bool one_layer() const { return one_layer_; }

  void close() {
    CPLErrorReset();
    dataset_.reset();
    if (CPLGetLastErrorType() >= CE_Failure) fail();
  }

 private:
  struct Close {
    void operator()(GDALDataset* dataset) const { GDALClose(dataset); }
  };

  OGRLayer* make_layer(const std::string& name, OGRwkbGeometryType type) {
    OGRLayer* layer = dataset_->CreateLayer(name.c_str(), type == wkbNone ? nullptr : &wgs84_, type, nullptr);
    if (layer == nullptr) fail();
    return layer;
  }

  static void set(OGRFeature& feature, const std::string& name, const Cell& cell) {
    const int field = feature.GetFieldIndex(name.c_str());
    if (field < 0) return;
    if (const auto* text = std::get_if<std::string>(&cell)) feature.SetField(field, text->c_str());
    if (const auto* number = std::get_if<double>(&cell); number != nullptr && std::isfinite(*number)) {
      feature.SetField(field, *number);
    }
    if (const auto* number = std::get_if<std::int64_t>(&cell)) feature.SetField(field, static_cast<GIntBig>(*number));
  }

  [[noreturn]] void fail() const {
    throw Error({.what = "the recording cannot be exported", .where = path_, .found = CPLGetLastErrorMsg()});
  }

  std::filesystem::path path_;
  OGRSpatialReference wgs84_;
  std::unique_ptr<GDALDataset, Close> dataset_;
  bool one_layer_ = false;
};

// One file with a layer per table and one with the track. driver: "KML", "GPKG" or "Parquet"; throws Error where this
// GDAL does not have it. A Parquet file holds one table: the estimates.
void export_gdal(const FlightTables& tables, const std::string& driver, const std::filesystem::path& path) {
  Exporter exporter(driver, path);
  exporter.table(tables.estimates);
  if (!exporter.one_layer()) {
    exporter.table(tables.anchors);
    exporter.table(tables.fixes);
    if (driver != "KML") exporter.table(tables.events);
    exporter.track(tables.estimates);
  }
  exporter.close();
}

namespace fs = std::filesystem;

const char* driver_of(const std::string& format) {
  if (format == "kml") return "KML";
  return format == "gpkg" ? "GPKG" : "Parquet";
}

// GDAL writes under a hidden name beside the final one.
void export_file(const FlightTables& tables, const std::string& format, const fs::path& out) {
  const fs::path folder = out.has_parent_path() ? out.parent_path() : fs::path(".");
  StagingDirectory staging(folder / (out.filename().string() + ".export"));
  const fs::path written = staging.path() / fmt::format("out.{}", format);
  export_gdal(tables, driver_of(format), written);
  fs::rename(written, out);
}

class RecorderExportCommand final : public Command {
 public:
  std::string_view group() const override { return "recorder"; }
  std::string_view name() const override { return "export"; }
  std::string_view summary() const override { return "export estimates, anchors and events for other programs"; }
  std::string_view details() const override;
  std::string_view examples() const override;

  void setup(Options& options) override;
  int run(Context& context) override;

 private:
  std::filesystem::path recording_, out_;
  std::string format_;
  std::optional<std::string> session_;
};

std::string_view RecorderExportCommand::details() const {
  return R"(csv: OUT is a folder with estimates.csv, anchors.csv, fixes.csv (what was sent to the autopilot) and
events.csv. geojson: one file with the track, the estimates, the anchors, accepted and rejected, and
the fixes. kml and gpkg: one file with a layer for
each. parquet: one file with the estimates; needs a GDAL built with Apache Arrow, which Debian 12
does not provide.

Exit codes: 0 exported, 2 the job could not be done.)";
}

std::string_view RecorderExportCommand::examples() const {
  return R"(nadir recorder export recording --format geojson --out flight.geojson
nadir recorder export recording --format csv --out tables)";
}

void RecorderExportCommand::setup(Options& options) {
  options.positional("RECORDING", recording_, "folder of segments, or an MCAP file").required();
  options.value("--format", format_, "FORMAT", "output format")
      .required()
      .one_of({"csv", "geojson", "kml", "gpkg", "parquet"});
  options.value("--out", out_, "OUT", "folder (csv) or file to create").required();
  options.value("--session", session_, "ID", "session of the recording, if it holds several");
}

int RecorderExportCommand::run(Context& context) {
  if (fs::exists(out_)) {
    throw UsageError({.what = "the output already exists", .where = out_, .fix = "choose another --out"});
  }
  const FlightTables tables = read_flight_tables(recording_, session_);
  if (format_ == "csv") {
    StagingDirectory staging(out_);
    export_csv(tables, staging.path());
    staging.commit();
  } else if (format_ == "geojson") {
    write_file_atomic(out_, geojson_of(tables));
  } else {
    export_file(tables, format_, out_);
  }
  if (!context.quiet) {
    context.err << fmt::format("{}, {}, {}, {}\n", count(tables.estimates.rows.size(), "estimate"),
                               count(tables.anchors.rows.size(), "anchor"),
                               count(tables.fixes.rows.size(), "fix", "fixes"),
                               count(tables.events.rows.size(), "event"));
  }
  return kAccepted;
}

}  // namespace

std::unique_ptr<Command> make_recorder_export() { return std::make_unique<RecorderExportCommand>(); }

}  // namespace nadir
