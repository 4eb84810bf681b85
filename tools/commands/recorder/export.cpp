#include "commands/recorder/export.hpp"

#include <fmt/format.h>

#include <ostream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "cli/options.hpp"
#include "commands/recorder/export/export_gdal.hpp"
#include "commands/recorder/export/export_text.hpp"

namespace nadir {
namespace {

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

}  // namespace

std::string_view RecorderExportCommand::details() const {
  return "csv: OUT is a folder with estimates.csv, anchors.csv and events.csv. geojson: one file with the track, the\n"
         "estimates and the anchors, accepted and refused. kml and gpkg: one file with a layer for each. parquet: one\n"
         "file with the estimates; needs a GDAL with Apache Arrow, which Debian 12 does not have.\n\n"
         "Exit codes: 0 exported, 2 could not be done.";
}

std::string_view RecorderExportCommand::examples() const {
  return "nadir recorder export recording --format geojson --out flight.geojson\n"
         "nadir recorder export recording --format csv --out tables";
}

void RecorderExportCommand::setup(Options& options) {
  options.positional("RECORDING", recording_, "a folder of segments, or an MCAP file").required();
  options.value("--format", format_, "FORMAT", "csv, geojson, kml, gpkg or parquet")
      .required()
      .one_of({"csv", "geojson", "kml", "gpkg", "parquet"});
  options.value("--out", out_, "OUT", "folder (csv) or file that is made").required();
  options.value("--session", session_, "ID", "when the recording holds several");
}

int RecorderExportCommand::run(Context& context) {
  if (fs::exists(out_)) {
    throw UsageError({.what = "what is to be made is there already", .where = out_, .fix = "give another --out"});
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
    context.err << fmt::format("{} estimates, {} anchors, {} events\n", tables.estimates.rows.size(),
                               tables.anchors.rows.size(), tables.events.rows.size());
  }
  return kAccepted;
}

}  // namespace nadir
