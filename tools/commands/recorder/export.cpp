// nadir recorder export: a recording for other programs.
#include <ogrsf_frmts.h>

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string>
#include <variant>
#include <vector>

#include "base/error.hpp"
#include "base/files.hpp"
#include "cli/command.hpp"
#include "cli/options.hpp"
#include "cli/output.hpp"
#include "commands/commands.hpp"
#include "commands/recorder/flight_tables.hpp"
#include "geodesy/lon_lat.hpp"
#include "raster/gdal_drivers.hpp"

namespace nadir {
namespace {

using nlohmann::json;

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
    one_layer_ = driver_name == "Parquet";
    dataset_.reset(vector_writer(driver_name, path).Create(path.c_str(), 0, 0, 0, GDT_Unknown, nullptr));
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
